"""`uvms play`: an episode under a controller, in a window, a browser, a video or a plot."""

import contextlib
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import gymnasium
from typer import Option

from uvms_gym.cli.common import fail, line, need, prepare, progress, read_scene, user_errors
from uvms_gym.cli.environments import (
    EnvKwargs,
    Integrator,
    PeriodStep,
    Scene,
    check_environment,
    environment_arguments,
    with_step,
)
from uvms_gym.cli.episode_plot import Instant, plot_episode
from uvms_gym.cli.options import CONTROLLER_HELP, Policies, ranged
from uvms_gym.cli.pictures import GIF_RATE, GIF_SIZE, MIN_SIZE, MOST_RATE, MOST_SIZE, RATE, SIZE, Frame, read_settings
from uvms_gym.controllers.families import BASELINE, canonical
from uvms_gym.logs import Recorder
from uvms_gym.studies.comparison.own import make_controller
from uvms_gym.studies.comparison.summary import short_names
from uvms_gym.viewer.curves import error_curves

#: Maximum duration, s.
MOST_SECONDS = 3600.0
#: Packages of the extra `view`, by module.
NEEDS = {"PIL": "pillow", "imageio_ffmpeg": "imageio-ffmpeg", "pygame": "pygame", "viser": "viser"}
#: Default environments: of files and windows, and of the browser view, whose policies are shipped.
DEFAULT, STORM = "UVMS-StationKeep-v0", "UVMS-StationKeep-Storm-v0"
_SUFFIXES = (".mp4", ".gif", ".png")


def play(
    env: Annotated[
        str | None,
        Option(help=f"Environment, by Gymnasium's id. [default: {DEFAULT}, or {STORM} with --web]"),
    ] = None,
    scene: Scene = None,
    env_kwargs: EnvKwargs = None,
    integrator: Integrator = None,
    dt: PeriodStep = None,
    controller: Annotated[
        str | None, Option(metavar="NAME", help=f"{CONTROLLER_HELP}. [default: the task's reference, such as pd]")
    ] = None,
    policies: Policies = None,
    disturbance: Annotated[
        str | None, Option(metavar="NAME", help="Level of disturbances. [default: the environment's]")
    ] = None,
    seconds: Annotated[float, ranged(f"Duration, up to {MOST_SECONDS:g} s.", 0.0, MOST_SECONDS)] = 20.0,
    seed: Annotated[int, ranged("Seed of the episode.", 0)] = 0,
    out: Annotated[
        Path | None, Option(metavar="FILE", help="Video (.mp4), animation (.gif), or the last picture only (.png).")
    ] = None,
    window: Annotated[bool, Option("--window", help="Show the episode in a window.")] = False,
    web: Annotated[bool, Option("--web", help="Show the episode in a browser of this machine, with controls.")] = False,
    port: Annotated[int, ranged("Port of --web, at 127.0.0.1.", 1, 65535)] = 8080,
    size: Annotated[
        str | None,
        Option(
            metavar="WIDTHxHEIGHT",
            help=f"Size of pictures, even numbers of pixels, {MIN_SIZE} to {MOST_SIZE}. "
            f"[default: {SIZE}, of animations {GIF_SIZE}]",
        ),
    ] = None,
    fps: Annotated[
        float | None,
        Option(
            help=f"Pictures per second, 1 to {MOST_RATE:g}; what is between control instants is interpolated. "
            f"[default: {RATE:g}, of animations {GIF_RATE:g}]"
        ),
    ] = None,
    camera: Annotated[
        str | None,
        Option(
            metavar="AZIMUTH,ELEVATION[,DISTANCE]",
            help="Direction to the camera, degrees about the vertical from x and above the horizontal; distance, m. "
            "[default: -54.4,18.3, with all in the picture]",
        ),
    ] = None,
    plot: Annotated[
        Path | None,
        Option(metavar="FILE", help="PNG of disturbances, errors and actions over time, with or without a video."),
    ] = None,
    mcap: Annotated[
        Path | None,
        Option(metavar="FILE", help="MCAP of states and thrusts in ROS 2 messages, with or without a video."),
    ] = None,
) -> None:
    """Show an episode under a controller: in a window, a browser, a file, or a plot over time.

    Without --out, --plot, --mcap and --window it is shown in a browser. Folders of files are made.
    """
    # The browser view needs no further options.
    other = window or any(given is not None for given in (out, size, fps, camera, plot, mcap))
    web = web or not other
    env = env or (STORM if web else DEFAULT)
    arguments = environment_arguments(env_kwargs, scene=scene, disturbance=disturbance, integrator=integrator)
    arguments = with_step(arguments, dt, [env])
    if isinstance(given := arguments.get("scene"), str):
        read_scene(given)
    level = given if isinstance(given := arguments.get("disturbance"), str) else ""
    if web:
        if other:
            raise fail("--web goes without --out, --window, --size, --fps, --camera, --plot and --mcap")
        need({"viser": "viser"}, "view")
        _serve(_make(env, arguments, seconds), controller, seed, port)
        return
    if out is not None and window:
        raise fail("--out goes without --window")
    suffix = out.suffix.lower() if out is not None else ""
    if out is not None and suffix not in _SUFFIXES:
        raise fail(f"--out is {str(out)!r}, but must end in {', '.join(_SUFFIXES)}")
    if plot is not None and plot.suffix.lower() != ".png":
        raise fail(f"--plot is {str(plot)!r}, but must end in .png")
    if mcap is not None and mcap.suffix.lower() != ".mcap":
        raise fail(f"--mcap is {str(mcap)!r}, but must end in .mcap")
    drawn = out is not None or window
    if not drawn and (size, fps, camera) != (None, None, None):
        raise fail("--size, --fps and --camera go with --out or --window")
    settings = read_settings(size, fps, camera, suffix)
    needed = {"PIL": drawn, "imageio_ffmpeg": suffix == ".mp4", "pygame": window}
    need({module: NEEDS[module] for module, wanted in needed.items() if wanted}, "view")
    if mcap is not None:
        need({"mcap": "mcap", "rosbags": "rosbags"}, "ros2")
    made = _make(env, arguments, seconds)
    inner: Any = made.unwrapped
    with user_errors():
        chosen = canonical(controller or BASELINE[inner.task])
        control = make_controller(chosen, made)
    period = 1.0 / made.metadata["render_fps"]
    steps = max(1, round(seconds / period))
    title = f"{inner.snapshot().scene_name}  ·  {short_names([chosen])[chosen]}"
    prepare(None, out)
    prepare(None, plot)
    prepare(None, mcap)
    instants: list[Instant] = []
    with progress() as bar, contextlib.ExitStack() as stack:
        recorder = None if mcap is None else stack.enter_context(Recorder(mcap))
        task = bar.add_task("playing", total=steps)

        def moments() -> Iterator[Instant]:
            for instant in _run(made, control, seed, steps, period, recorder):
                instants.append(instant)
                bar.advance(task)
                yield instant

        # Errors of ffmpeg name no file.
        try:
            if drawn:
                _show(made, moments(), Frame(title, level, steps * period, settings), out)
            else:
                deque(moments(), maxlen=0)
        except OSError as error:
            raise fail(f"cannot write {error.filename or out}: {error.strerror or error}") from None
    if (end := instants[-1].time) < (steps - 0.5) * period:
        line(f"the episode ended after {end:g} s")
    if plot is not None:
        names = [block.name for block in inner.action_layout]
        with user_errors(verb="write"):
            plot_episode(plot, f"{title}, {level}" if level else title, names, error_curves(made), instants)
    for file in filter(None, (out, plot, mcap)):
        line(str(file))


def _run(
    env: gymnasium.Env[Any, Any], control: Any, seed: int, steps: int, period: float, recorder: Recorder | None
) -> Iterator[Instant]:
    inner: Any = env.unwrapped
    observation, info = env.reset(seed=seed)
    state = None
    yield Instant(0.0, info, None)
    with contextlib.closing(env):
        for step in range(1, steps + 1):
            # A controller of a user's own may do anything.
            with user_errors():
                action, state = control.predict(observation, state)
                if recorder is not None:
                    forces = inner.forces(action, observation)
                    recorder.add(inner.snapshot(), (step - 1) * period, forces=forces)
                observation, _, terminated, truncated, info = env.step(action)
            yield Instant(step * period, info, action)
            if terminated or truncated:
                break
        if recorder is not None:
            recorder.add(inner.snapshot(), step * period)


def _show(env: gymnasium.Env[Any, Any], moments: Iterator[Instant], frame: Frame, out: Path | None) -> None:
    from uvms_gym.cli.film import film, write_film
    from uvms_gym.envs.window import Window

    inner: Any = env.unwrapped
    if out is not None:
        write_film(out, film(inner, moments, frame, out.suffix.lower() == ".png"), frame.settings.rate)
        return
    with contextlib.closing(Window(frame.title)) as window:
        for picture in film(inner, moments, frame):
            window.show(picture, frame.settings.rate)


def _serve(env: gymnasium.Env[Any, Any], controller: str | None, seed: int, port: int) -> None:
    from uvms_gym.viewer.episode import LiveEpisode
    from uvms_gym.viewer.server import HOST, Viewer

    inner: Any = env.unwrapped
    with user_errors():
        episode = LiveEpisode(inner, controller or BASELINE[inner.task], seed)
    title = f"{inner.snapshot().scene_name}, {env.spec.id if env.spec else inner.task}"
    try:
        viewer = Viewer(episode, title, port, line)
    except OSError as error:
        raise fail(f"--port is {port}, but {HOST} refuses it: {error.strerror or error}") from None
    except RuntimeError as error:
        raise fail(str(error)) from None
    line(f"{viewer.url} (this machine only; Ctrl-C ends it)")
    try:
        viewer.run()
    except KeyboardInterrupt:
        line("ended")
    finally:
        viewer.close()


def _make(env: str, arguments: dict[str, Any], seconds: float) -> gymnasium.Env[Any, Any]:
    check_environment(env)
    # A limit beyond the end.
    options = {"max_episode_steps": round(1000.0 * seconds) + 1000, **arguments}
    with user_errors(f"{env}: "):
        made = gymnasium.make(env, **options | {"render_mode": "rgb_array", "disable_env_checker": True})
    if "rgb_array" not in made.metadata["render_modes"] or not hasattr(made.unwrapped, "snapshot"):
        raise fail(f"--env is {env!r}, but only environments of uvms_gym work, such as UVMS-StationKeep-v0")
    return made
