"""`uvms ros2`: nodes of ROS 2."""

import tomllib
from pathlib import Path
from typing import Annotated, Any

import gymnasium
import numpy as np
from typer import Option

from uvms_gym._files import read_text
from uvms_gym.cli.common import fail, line, need, prepare, user_errors
from uvms_gym.cli.environments import EnvKwargs, Scene, check_environment, environment_arguments
from uvms_gym.cli.options import CONTROLLER_HELP, Json, Policies, ranged, several, vector
from uvms_gym.cli.output import write_json
from uvms_gym.controllers.contract import check_contract
from uvms_gym.controllers.families import BASELINE, canonical
from uvms_gym.envs.base import TaskEnv
from uvms_gym.studies.comparison.own import make_controller

#: Packages of the extra `ros2-node`, by module.
NEEDS = {
    "nav_msgs": "ros-kilted-nav-msgs",
    "rclpy": "ros-kilted-rclpy",
    "sensor_msgs": "ros-kilted-sensor-msgs",
    "std_srvs": "ros-kilted-std-srvs",
}

Environment = Annotated[str, Option("--env", help="Environment, by Gymnasium's id.")]
Disturbance = Annotated[str | None, Option(metavar="NAME", help="Level of disturbances. [default: the environment's]")]
Seed = Annotated[int, ranged("Seed of the episode.", 0)]
Seconds = Annotated[float | None, ranged("End, s of simulation time. [default: Ctrl-C]", 0.0)]
Namespace = Annotated[str, Option(metavar="NAME", help="Namespace of node and topics.")]
Remap = Annotated[list[str] | None, several("Other name of a topic or of the node", "none", metavar="FROM:=TO")]
Wait = Annotated[float, ranged("Time to wait for messages that must come, s.", 0.1)]


def simulate(
    env: Environment = "UVMS-StationKeep-v0",
    scene: Scene = None,
    env_kwargs: EnvKwargs = None,
    disturbance: Disturbance = None,
    seed: Seed = 0,
    seconds: Seconds = None,
    factor: Annotated[float, ranged("Simulation time per wall time.", 0.01, 100.0)] = 1.0,
    lockstep: Annotated[
        bool, Option("--lockstep", help="Wait for a command on every measurement, instead of the wall clock.")
    ] = False,
    wait_for_controller: Annotated[
        bool, Option("--wait-for-controller", help="Begin once a controller receives odom and publishes commands.")
    ] = False,
    sensors: Annotated[
        Path | None,
        Option(
            metavar="FILE", help="TOML file: tables [imu], [dvl], [depth] with settings of `Sensors`. [default: none]"
        ),
    ] = None,
    namespace: Namespace = "/",
    remap: Remap = None,
    wait: Wait = 30.0,
    json_file: Json = None,
) -> None:
    """Simulate a vehicle as a node: sensors, /clock and TF out, thrusts, wrench and joint targets in.

    Without commands for 0.5 s the thrusts are 0 and joints hold. The service `reset` begins the next episode;
    `imu/fail`, `dvl/fail` and `pressure/fail` let a sensor fail and work again.
    """
    need(NEEDS, "ros2-node")
    from uvms_gym.ros2.messages import SENSORS
    from uvms_gym.ros2.session import session
    from uvms_gym.ros2.simulator import SimulatorNode
    from uvms_gym.ros2.vehicle import SimulatedVehicle

    prepare(None, json_file)
    made = _make(env, environment_arguments(env_kwargs, scene=scene, disturbance=disturbance), action="thrusters")
    owned = [*(name for name in SENSORS if name != "/tf"), "contract"]
    suite: dict[str, Any] = {}
    if sensors is not None:
        with user_errors(f"{sensors}: "):
            suite = tomllib.loads(read_text(sensors))
    with user_errors():
        vehicle = SimulatedVehicle(made, seed, suite)
    with user_errors(), session("uvms_simulator", namespace, remap or (), owned) as running:
        given: dict[str, Any] = {
            "factor": factor,
            "lockstep": lockstep,
            "wait_for_controller": wait_for_controller,
            "patience": wait,
        }
        node = SimulatorNode(running, vehicle, **given)
        line(f"{made.snapshot().scene_name} on the topics of {running.node.get_fully_qualified_name()}; Ctrl-C ends it")
        try:
            node.run(float("inf") if seconds is None else seconds)
        except KeyboardInterrupt:
            line("ended")
        finally:
            found = node.summary()
            text = "{time:g} s; RMS position error {rms_position_error:.4g} m; {late:g} periods late; "
            text += "deadman {deadman:g} times"
            if "round_trip_median" in found:
                text += "; round trip median {round_trip_median:.2g} s, 95 % {round_trip_95:.2g} s, "
                text += "maximum {round_trip_maximum:.2g} s"
            line(text.format(**found))
            if json_file is not None:
                write_json(json_file, found)


def control(
    env: Environment = "UVMS-StationKeep-v0",
    scene: Scene = None,
    env_kwargs: EnvKwargs = None,
    disturbance: Disturbance = None,
    controller: Annotated[
        str | None, Option(metavar="NAME", help=f"{CONTROLLER_HELP}. [default: the task's reference, such as pd]")
    ] = None,
    policies: Policies = None,
    seed: Annotated[int, ranged("Seed of the references.", 0)] = 0,
    target: Annotated[
        str | None,
        Option(metavar="X,Y,Z,HEADING", help="Target, m and rad, in the frame of odom. [default: the environment's]"),
    ] = None,
    contract: Annotated[
        Path | None,
        Option(metavar="FILE", help="Contract of `uvms export` that environment and policy must meet. [default: none]"),
    ] = None,
    seconds: Seconds = None,
    namespace: Namespace = "/",
    remap: Remap = None,
    wait: Wait = 10.0,
) -> None:
    """Run a controller or policy as a node: odom and joint_states in, wrench or thrusts and joint targets out.

    Contract and rate of the vehicle are checked before the first command.
    """
    need(NEEDS, "ros2-node")
    from uvms_gym.ros2.controller import ControllerNode
    from uvms_gym.ros2.messages import COMMANDS
    from uvms_gym.ros2.observer import Observer
    from uvms_gym.ros2.session import session

    made = _make(env, environment_arguments(env_kwargs, scene=scene, disturbance=disturbance))
    start: dict[str, Any] = {}
    if target is not None:
        numbers = vector("--target", target)
        if len(numbers) != 4 or not np.isfinite(numbers).all():
            raise fail(f'--target "{target}" must be 4 finite numbers, X,Y,Z,HEADING')
        half = 0.5 * numbers[3]
        start = {"target_position": numbers[:3], "target_attitude": [np.cos(half), 0.0, 0.0, np.sin(half)]}
    with user_errors():
        chosen = make_controller(canonical(controller or BASELINE[made.task], task=made.task), made)
        if contract is not None:
            check_contract(contract, made, controller=chosen)
        observer = Observer(made, chosen, seed, start)
    with user_errors(), session("uvms_controller", namespace, remap or (), list(COMMANDS)) as running:
        node = ControllerNode(running, observer, patience=wait)
        name, topic = running.node.get_fully_qualified_name(), running.node.resolve_topic_name("odom")
        line(f"{name} waits for {topic}; Ctrl-C ends it")
        try:
            node.run(float("inf") if seconds is None else seconds)
        except KeyboardInterrupt:
            line("ended")
        finally:
            line(f"{node.commands} commands")


def _make(env: str, arguments: dict[str, Any], **forced: Any) -> TaskEnv:
    check_environment(env)
    with user_errors(f"{env}: "):
        made: Any = gymnasium.make(env, disable_env_checker=True, **{**arguments, **forced}).unwrapped
    if not isinstance(made, TaskEnv):
        raise fail(f"--env is {env!r}, but only environments of uvms_gym work, such as UVMS-StationKeep-v0")
    return made
