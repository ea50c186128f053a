"""`uvms play --web`: an episode in a browser of this machine."""

from typing import Any

import gymnasium

from uvms_gym.cli.common import fail, line, user_errors
from uvms_gym.controllers.families import BASELINE


def serve(env: gymnasium.Env[Any, Any], controller: str | None, seed: int, port: int) -> None:
    """Serve the page until Ctrl-C."""
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
