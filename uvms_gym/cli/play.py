"""`uvms play`: an episode under a controller, in a window, a browser, a video or a plot."""

import contextlib
import math
import warnings
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import gymnasium
from typer import Option

from uvms_gym.cli.common import (
    EnvKwargs,
    Scene,
    check_range,
    environment_arguments,
    fail,
    line,
    prepare,
    progress,
    read_scene,
    user_errors,
)
from uvms_gym.cli.episode_plot import Instant, plot_episode
from uvms_gym.cli.web import serve
from uvms_gym.controllers import registry
from uvms_gym.studies.comparison.own import PREFIX, make_controller

if TYPE_CHECKING:
    from uvms_gym.cli.overlay import Overlay

#: Greatest duration, s.
MOST_SECONDS = 3600.0
#: Optional modules: package and extra of each.
NEEDS = {
    "PIL": ("pillow", "video"),
    "imageio_ffmpeg": ("imageio-ffmpeg", "video"),
    "pygame": ("pygame", "human"),
    "viser": ("viser", "web"),
}
#: Default environments: of files and windows, and of the browser view, whose policies are shipped.
DEFAULT, STORM = "UVMS-StationKeep-v0", "UVMS-StationKeep-Storm-v0"
_SUFFIXES = (".mp4", ".gif", ".png")
KNOWN = f"{', '.join(registry.NAMES)}, {registry.MLP_PREFIX}FILE, {PREFIX}FILE.py:NAME"


def play(
    env: Annotated[
        str | None,
        Option(help=f"Environment, by Gymnasium's id. [default: {DEFAULT}, or {STORM} with --web]"),
    ] = None,
    scene: Scene = None,
    env_kwargs: EnvKwargs = None,
    controller: Annotated[
        str | None, Option(help=f"One of {KNOWN}. [default: pd, or resolved for end-effector tracking]")
    ] = None,
    disturbance: Annotated[
        str | None, Option(metavar="NAME", help="Level of disturbances. [default: the environment's]")
    ] = None,
    seconds: Annotated[float, Option(help=f"Duration, up to {MOST_SECONDS:g} s.")] = 20.0,
    seed: Annotated[int, Option(help="Seed of the episode.")] = 0,
    out: Annotated[
        Path | None, Option(metavar="FILE", help="Video (.mp4), animation (.gif), or the last picture only (.png).")
    ] = None,
    window: Annotated[bool, Option("--window", help="Show the episode in a window.")] = False,
    web: Annotated[bool, Option("--web", help="Show the episode in a browser of this machine, with controls.")] = False,
    port: Annotated[int, Option(help="Port of --web, at 127.0.0.1.")] = 8080,
    plot: Annotated[
        Path | None,
        Option(metavar="FILE", help="PNG of disturbances, errors and actions over time, with or without a video."),
    ] = None,
) -> None:
    """Show an episode under a controller: in a window, a browser, a file, or a plot over time."""
    check_range("--seconds", seconds, 0.0, MOST_SECONDS)
    check_range("--seed", seed, 0, math.inf)
    env = env or (STORM if web else DEFAULT)
    arguments = environment_arguments(env_kwargs, scene=scene, disturbance=disturbance)
    if isinstance(given := arguments.get("scene"), str):
        read_scene(given)
    level = given if isinstance(given := arguments.get("disturbance"), str) else ""
    if web:
        if out is not None or window or plot is not None:
            raise fail("--web goes without --out, --window and --plot")
        check_range("--port", port, 1, 65535)
        _need("viser")
        serve(_make(env, arguments, seconds), controller, seed, port)
        return
    if (out is not None and window) or (out is None and not window and plot is None):
        raise fail("--out FILE, --window, --plot FILE or --web is needed, and not the first two together")
    suffix = out.suffix.lower() if out is not None else ""
    if out is not None and suffix not in _SUFFIXES:
        raise fail(f"--out is {str(out)!r}, but must end in {', '.join(_SUFFIXES)}")
    if plot is not None and plot.suffix.lower() != ".png":
        raise fail(f"--plot is {str(plot)!r}, but must end in .png")
    pictures = ["PIL"] if out is not None or window else []
    _need(*pictures, *(["pygame"] if window else []), *(["imageio_ffmpeg"] if suffix == ".mp4" else []))
    made = _make(env, arguments, seconds)
    chosen = controller or registry.BASELINE[made.unwrapped.task]  # type: ignore[attr-defined]
    with user_errors():
        control = make_controller(chosen, made)
    period = 1.0 / made.metadata["render_fps"]
    steps = max(1, round(seconds / period))
    name = Path(chosen).name if chosen.startswith(registry.MLP_PREFIX) else chosen
    title = f"{made.unwrapped.snapshot().scene_name}  ·  {name}"  # type: ignore[attr-defined]
    overlay = None
    if pictures:
        from uvms_gym.cli.overlay import Overlay

        overlay = Overlay(title, level, steps * period)
    prepare(None, out)
    prepare(None, plot)
    shown = _Recorder(made, overlay, period)
    with progress() as bar:
        task = bar.add_task("playing", total=steps)
        # Errors of ffmpeg name no file.
        try:
            if window:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")
                    for _ in _run(gymnasium.wrappers.HumanRendering(shown), control, seed, steps):
                        bar.advance(task)
            elif out is None:
                for _ in _run(shown, control, seed, steps):
                    bar.advance(task)
            else:
                _film(out, shown, _run(shown, control, seed, steps), lambda: bar.advance(task))
        except OSError as error:
            raise fail(f"cannot write {error.filename or out}: {error.strerror or error}") from None
    if shown.time < (steps - 0.5) * period:
        line(f"the episode ended after {shown.time:g} s")
    if plot is not None:
        names = [block.name for block in made.unwrapped.action_layout]  # type: ignore[attr-defined]
        with user_errors(verb="write"):
            plot_episode(plot, f"{title}, {level}" if level else title, names, shown.instants)
    for file in filter(None, (out, plot)):
        line(str(file))


class _Recorder(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Record of an episode, and pictures with an overlay."""

    def __init__(self, env: gymnasium.Env[Any, Any], overlay: "Overlay | None", period: float) -> None:
        super().__init__(env)
        self._overlay = overlay
        self._period = period
        self.instants: list[Instant] = []

    @property
    def time(self) -> float:
        """Time since the start, s."""
        return (len(self.instants) - 1) * self._period

    def reset(self, **kwargs: Any) -> tuple[Any, dict[str, Any]]:
        observation, info = self.env.reset(**kwargs)
        self.instants = []
        self._append(info, None)
        return observation, info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        result = self.env.step(action)
        self._append(result[4], action)
        return result

    def render(self) -> Any:
        picture = self.env.render()
        return picture if self._overlay is None else self._overlay.draw(picture, self.instants[-1][1])  # type: ignore[arg-type]

    def _append(self, info: dict[str, Any], action: Any) -> None:
        self.instants.append(Instant(len(self.instants) * self._period, info, action))
        if self._overlay is not None:
            self._overlay.note(self.time, info)


def _run(env: gymnasium.Env[Any, Any], control: Any, seed: int, steps: int) -> Iterator[None]:
    """Step through an episode; yields at its start and after each step."""
    observation, _ = env.reset(seed=seed)
    state = None
    yield
    with contextlib.closing(env):
        for _ in range(steps):
            # A controller of a user's own may do anything.
            with user_errors():
                action, state = control.predict(observation, state)
                observation, _, terminated, truncated, _ = env.step(action)
            yield
            if terminated or truncated:
                return


def _film(out: Path, env: _Recorder, instants: Iterator[None], tick: Callable[[], None]) -> None:
    """Write pictures of all instants; for a single picture render the last one only."""
    from uvms_gym.cli.film import write_film

    def pictures() -> Iterator[Any]:
        for _ in instants:
            tick()
            if suffix != ".png":
                yield env.render()
        if suffix == ".png":
            yield env.render()

    suffix = out.suffix.lower()
    write_film(out, pictures(), env.metadata["render_fps"])


def _need(*modules: str) -> None:
    """Refuse to run without optional modules."""
    missing = [NEEDS[module] for module in modules if find_spec(module) is None]
    if missing:
        packages, extras = (sorted({pair[k] for pair in missing}) for k in (0, 1))
        raise fail(f"{', '.join(packages)} not installed; run: pip install 'uvms-gym[{','.join(extras)}]'")


def _make(env: str, arguments: dict[str, Any], seconds: float) -> gymnasium.Env[Any, Any]:
    # A limit beyond the end.
    options = {"max_episode_steps": round(1000.0 * seconds) + 1000, **arguments}
    with user_errors(f"{env}: "):
        made = gymnasium.make(env, **options | {"render_mode": "rgb_array", "disable_env_checker": True})
    if "rgb_array" not in made.metadata["render_modes"] or not hasattr(made.unwrapped, "snapshot"):
        raise fail(f"--env is {env!r}, but only environments of uvms_gym work, such as UVMS-StationKeep-v0")
    return made
