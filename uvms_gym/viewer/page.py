"""Controls and curves of the page."""

import math
import re
import time
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import viser

from uvms_gym.controllers import registry
from uvms_gym.controllers.families import canonical, is_file, split
from uvms_gym.viewer.curves import error_curves
from uvms_gym.viewer.episode import HOME, MAXIMA, MOST_SEED, LiveEpisode
from uvms_gym.viewer.gate import Gate
from uvms_gym.viewer.world import World

#: Duration of the curves, s.
SPAN = 30.0
#: Rest of a text that is being typed, before it counts, s; time within which a notice is not repeated, s.
REST, _NOTICE = 0.7, 8.0
SPEEDS = {"0.25x": 0.25, "0.5x": 0.5, "1x": 1.0, "2x": 2.0, "4x": 4.0}
_THRUSTERS = ("#ff8c28", "#82d7ff", "#78eba0", "#ffcd5a", "#ff78d7", "#b79cff", "#e6e6e6", "#d95f5f")
_NOTE = (
    "A change here, or of the target, begins a new episode of the same seed from the present state: the disturbance "
    "starts over. Strength 1 is the level as named. Reset begins at the start that the seed draws."
)


class Page:
    """Controls of one episode on a server.

    Callbacks of the server's threads put commands into a queue; the thread that steps the episode runs them.

    `running` is False while paused, `speed` is in simulated seconds per second, and `stepped` is True once a single
    step was requested.
    """

    def __init__(self, server: viser.ViserServer, gate: Gate, episode: LiveEpisode, world: World, title: str) -> None:
        self._server, self._gate, self._episode, self._world, self._gizmo = server, gate, episode, world, world.gizmo
        self._commands: dict[str, tuple[float, Callable[[], None]]] = {}
        self._said = ("", -math.inf)
        self.running, self.speed, self.stepped = True, 1.0, False
        gui = server.gui
        gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False, control_width="large")
        gui.set_panel_label("uvms play")
        gui.add_markdown(f"**{title}**")
        #: Settings of each family, the default first.
        self._settings: dict[str, list[str]] = {}
        names = registry.available(episode.env)
        for name in names if episode.controller in names else (episode.controller, *names):
            family, setting = split(name)
            settings = self._settings.setdefault(family, [])
            settings.insert(0 if name == family else len(settings), setting)
        family, setting = split(episode.controller)
        self.controller = gui.add_dropdown("Controller", list(self._settings), initial_value=family)
        self.setting = gui.add_dropdown("Setting", self._settings[family], initial_value=setting)
        self._on(self.controller, "controller", self._choose)
        self._on(self.setting, "controller", self._choose)
        self.pace = gui.add_dropdown("Speed", tuple(SPEEDS), initial_value="1x")
        self._on(self.pace, "speed", self._set_speed)
        # A text: browsers round numbers from 2^53 on, and correct those that are out of range without a word.
        self.seed = gui.add_text("Seed", str(episode.seed))
        self._on(self.seed, "seed", self._reseed, REST)
        self.buttons = gui.add_button_group("Episode", ("Run", "Pause", "Step", "Reset"))
        self._on(self.buttons, "button", lambda: self.press(self.buttons.value))
        self.view = gui.add_button_group("View", ("Home",))
        self.view.on_click(lambda event: self.home(event.client))
        self.follow, self.handles = gui.add_checkbox("Follow vehicle", False), gui.add_checkbox("Target handles", True)
        self._on(self.follow, "follow", self._set_view)
        self._on(self.handles, "handles", self._set_view)
        with gui.add_folder(f"Disturbance: {episode.level}"):
            now = episode.conditions
            self.strength = gui.add_slider("Strength", 0.0, MAXIMA["strength"], 0.05, now.strength)
            self.current = gui.add_slider("Current (m/s)", 0.0, MAXIMA["current"], 0.01, now.current)
            self.payload = gui.add_slider("Payload (kg)", 0.0, MAXIMA["payload"], 0.1, now.payload)
            gui.add_markdown(f"<small>{_NOTE}</small>")
        for name in MAXIMA:
            self._on(getattr(self, name), name, partial(self._slide, name))
        self._gizmo.on_update(lambda event: self._put("target", self._drag) if event.phase == "end" else None)
        self._status = gui.add_markdown("")
        self._rows: deque[list[float]] = deque(maxlen=max(2, round(SPAN / episode.period)))
        self._curves = error_curves(episode.env)
        self._errors = self._chart("Errors", [(f"{c.title} ({c.unit})", c.colour) for c in self._curves])
        thrusters = episode.env.snapshot().thruster_names
        self._thrusts = self._chart("Thrust (N)", list(zip(thrusters, _THRUSTERS * (len(thrusters) // 8 + 1))))
        self.note()
        gate.admit(self.view)
        gate.handles = self._gizmo.name
        gate.refused = lambda reason: self._put("refused", lambda: self.say("Refused", reason))

    def run_commands(self) -> None:
        """Run the commands that are due, of one kind the last only; one that fails changes nothing."""
        now = time.monotonic()
        for kind in [kind for kind, (due, _) in list(self._commands.items()) if due <= now]:
            self.attempt(self._commands.pop(kind)[1], "Refused", self._restore)

    def attempt(self, action: Callable[[], None], title: str, undo: Callable[[], None]) -> None:
        """Run something; any error is a notice, after which `undo` runs."""
        try:
            action()
        except (KeyboardInterrupt, SystemExit):
            raise
        except BaseException as error:  # A panic of the native module is no Exception.
            self.say(title, " ".join(str(error).split()) or type(error).__name__)
            undo()

    def pause(self) -> None:
        """Stop stepping."""
        self.running = self.stepped = False

    def say(self, title: str, text: str) -> None:
        """Show a notice in every browser, unless it is the last one again."""
        said, now = f"{title}: {text}", time.monotonic()
        if said != self._said[0] or now - self._said[1] >= _NOTICE:
            self._said = said, now
            for client in self._server.get_clients().values():
                client.add_notification(title, text, auto_close_seconds=_NOTICE)

    def home(self, client: viser.ClientHandle | None) -> None:
        """Turn the camera of one browser to the vehicle."""
        if client is not None:
            self._put(f"home of {client.client_id}", partial(self._home, client.client_id))

    def press(self, button: str) -> None:
        """Do what a button says: Run, Pause, Step or Reset."""
        if button == "Reset":
            self.reset(_seed(self.seed.value))
        else:
            self.running, self.stepped = button == "Run", button == "Step"

    def reset(self, seed: int) -> None:
        """Begin at the start that a seed draws, with the target at the world's origin and empty curves."""
        self._episode.reset(seed, HOME)
        self._gizmo.position, self._gizmo.wxyz = HOME
        self.clear()
        self.note()

    def clear(self) -> None:
        """Empty the curves."""
        self._rows.clear()

    def note(self) -> None:
        """Append the present errors and thrusts to the curves."""
        episode = self._episode
        errors = (curve.scale * episode.info[curve.entry] for curve in self._curves)
        self._rows.append([episode.time, *errors, *episode.after["thrust"]])

    def draw_curves(self, rate: float) -> None:
        """Send the curves, and the state in words with the rate of pictures, 1/s."""
        columns = np.array(self._rows).T
        count = len(self._curves)
        info, time = self._episode.info, self._episode.time
        self._errors.data = (columns[0] - time, *columns[1 : 1 + count])
        self._thrusts.data = (columns[0] - time, *columns[1 + count :])
        speed = np.linalg.norm(self._episode.after["current"])
        state = "running" if self.running else "paused"
        self._status.content = (
            f"{state}, {time:.1f} s: pose error {100.0 * info['pose_error']:.1f} cm, water {speed:.2f} m/s, "
            f"{rate:.0f} pictures/s"
        )

    def _home(self, number: int) -> None:
        # It may have left meanwhile.
        if client := self._server.get_clients().get(number):
            self._world.place_camera(client.camera, client.camera.image_width)

    def _choose(self) -> None:
        family = self.controller.value
        if list(self.setting.options) != self._settings[family]:
            self.setting.options = self._settings[family]
        name = family if is_file(family) else canonical(family, self.setting.value)
        if name != self._episode.controller:
            self._episode.choose(name)

    def _reseed(self) -> None:
        if (seed := _seed(self.seed.value)) != self._episode.seed:
            self.reset(seed)

    def _slide(self, name: str) -> None:
        changes: dict[str, Any] = {name: getattr(self, name).value}
        if changes[name] != getattr(self._episode.conditions, name):
            self._episode.change(**changes)

    def _drag(self) -> None:
        self._episode.change((np.array(self._gizmo.position), np.array(self._gizmo.wxyz)))

    def _restore(self) -> None:
        episode = self._episode
        family, setting = split(episode.controller)
        self.controller.value, self.seed.value = family, str(episode.seed)
        self.setting.options, self.setting.value = self._settings[family], setting
        for name in MAXIMA:
            getattr(self, name).value = getattr(episode.conditions, name)
        self._gizmo.position, self._gizmo.wxyz = episode.target

    def _set_view(self) -> None:
        self._gizmo.visible = self.handles.value
        if self.follow.value != self._world.follow:
            self._world.follow = self.follow.value
            for number in self._server.get_clients():
                self._home(number)

    def _set_speed(self) -> None:
        self.speed = SPEEDS[self.pace.value]

    def _on(self, handle: Any, kind: str, command: Callable[[], None], rest: float = 0.0) -> None:
        """Run a command at every change of a control, after a rest, s; the value of the last change counts."""
        self._gate.admit(handle)
        register = handle.on_click if hasattr(handle, "on_click") else handle.on_update
        register(lambda _: self._put(kind, command, rest))

    def _put(self, kind: str, command: Callable[[], None], rest: float = 0.0) -> None:
        self._commands[kind] = (time.monotonic() + rest, command)

    def _chart(self, title: str, curves: list[tuple[str, str]]) -> Any:
        """Chart of named curves over the time before now."""
        axis = {"stroke": "#cddee4", "grid": {"stroke": "#ffffff22", "width": 1}}
        drawn = ({"label": name, "stroke": colour, "width": 1.5} for name, colour in curves)
        return self._server.gui.add_uplot(
            (np.zeros(1),) * (1 + len(curves)),
            ({"label": "before now (s)"}, *drawn),
            title=title,
            # A constant range: charts that follow their data lose it in browsers that come later.
            scales={"x": {"time": False, "range": (-SPAN, 0.0)}},
            axes=(axis, axis),
            aspect=1.7,
        )


def _seed(text: str) -> int:
    if not re.fullmatch("[0-9]{1,20}", text.strip()):
        raise ValueError(f"seed is {text!r}, but must be a whole number from 0 to {MOST_SEED}")
    return int(text)
