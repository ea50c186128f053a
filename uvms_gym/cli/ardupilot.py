"""`uvms ardupilot`: a simulated vehicle for ArduPilot's SITL."""

from pathlib import Path
from typing import Annotated

from typer import Option

from uvms_gym.ardupilot import Bridge, serve
from uvms_gym.cli.common import line, user_errors
from uvms_gym.cli.options import SceneArgument, ranged


def ardupilot(
    scene: SceneArgument,
    map_file: Annotated[
        Path, Option("--map", metavar="FILE", help="Map of logs, whose thrusters name channels (docs/ardupilot.md).")
    ],
    host: Annotated[str, Option(help="Address that packets come to.")] = "127.0.0.1",
    port: Annotated[int, ranged("UDP port that packets come to.", 1, 65535)] = 9002,
    depth: Annotated[float, ranged("Depth of the start below the world's origin, m.", 0.0, 10_000.0)] = 0.0,
) -> None:
    """Simulate a vehicle for ArduPilot's SITL by its JSON interface, frame by frame, until Ctrl-C.

    SITL is started with --model JSON. Packets that are damaged, repeated or missing are named.
    """
    with user_errors():
        bridge = Bridge(scene, map_file, depth)
    try:
        with user_errors():
            serve(bridge, host, port, line)
    except KeyboardInterrupt:
        line("ended")
