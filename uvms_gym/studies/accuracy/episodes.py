"""Episodes of an environment under recorded actions, by any integrator, step and precision.

Seeds, disturbances and sensor noise are drawn by control period, so they do not depend on the step.
"""

import warnings
from collections.abc import Mapping
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from numpy.typing import NDArray

from uvms_gym import StepWarning, make_controller
from uvms_gym.controllers import Controller, registry
from uvms_gym.controllers.families import BASELINE, is_learned, role
from uvms_gym.disturbances import disturbance_levels
from uvms_gym.envs import Block, TaskVectorEnv
from uvms_gym.studies.numerics import Floats

Options = Mapping[str, Any]
#: Name of the drive by uniformly distributed actions; the others are named by their controllers.
RANDOM = "random"


class Configuration(NamedTuple):
    """Integrator, number type, and step, s."""

    integrator: str
    dtype: str
    step: float

    @property
    def title(self) -> str:
        """Text of all three."""
        return f"{self.integrator} {self.dtype} at {self.step:g} s"


class Case(NamedTuple):
    """Environment with its options, the number of episodes, and the seed of the first."""

    env: str
    #: Arguments of `gymnasium.make_vec`.
    options: Options
    episodes: int
    seed: int


class Frame(NamedTuple):
    """Properties of a case: task, control period in s, control periods of an episode, and its own configuration."""

    task: str
    period: float
    steps: int
    default: Configuration
    #: Maximum stable step of each integrator, s.
    stable_steps: dict[str, float]
    #: Blocks of an observation.
    layout: tuple[Block, ...]
    #: Drives: random actions, the task's classical controller, and the first shipped policy, if there is one.
    drives: dict[str, Controller | None]


class Recording(NamedTuple):
    """Episodes of N instances over T control periods; values are those at the end of each control period."""

    #: (T, N, a) float32
    actions: NDArray[np.float32]
    #: (T, N, d)
    observations: Floats
    #: (T, N)
    rewards: Floats
    #: (T, N) True up to the end of the instance's episode, included.
    running: NDArray[np.bool_]
    #: (T, N, 3), m; (T, N, 3, 3); (T, N, n), rad or m; (T, N, 3), m
    position: Floats
    rotation: Floats
    q: Floats
    end_effector: Floats
    #: Texts of the step warnings.
    warned: list[str]


def frame(case: Case) -> Frame:
    """Read the properties of a case from its environment."""
    known = [name for name, spec in gymnasium.registry.items() if str(spec.entry_point).startswith("uvms_gym.envs:")]
    if case.env not in known:
        raise ValueError(f"unknown environment {case.env!r}; known: {', '.join(known)}")
    envs = gymnasium.make_vec(case.env, num_envs=1, **case.options)
    try:
        inner: TaskVectorEnv = envs.unwrapped  # type: ignore[assignment]
        options, simulator = inner.options, inner.snapshot()
        classical = BASELINE[inner.task]
        # The scene's own.
        policies = [
            one for one in registry.available(envs) if is_learned(one) and role(one) not in ("general", "by name")
        ]
        drives = {name: make_controller(name, envs) for name in (classical, *policies[:1])}
        return Frame(
            inner.task,
            float(f"{inner.control_period:.12g}"),
            int(case.options.get("max_episode_steps", gymnasium.registry[case.env].max_episode_steps) or 0),
            Configuration(simulator.integrator, options.dtype, simulator.dt),
            # Joint servos are on, and random actions reach the end stops.
            simulator.stable_steps(vehicle_servo=False),
            inner.layout,
            {RANDOM: None, **drives},
        )
    finally:
        envs.close()


def divides(step: float, period: float) -> bool:
    """True if a control period is a whole number of steps."""
    return step > 0.0 and round(period / step) >= 1 and abs(round(period / step) * step / period - 1.0) < 1e-9


def record(
    case: Case, about: Frame, configuration: Configuration, drive: NDArray[np.float32] | Controller | None
) -> Recording:
    """Run the first episode of every instance.

    The step of `configuration` divides the control period. `drive` are actions (T, N, a), a controller in the loop that
    gives them, or None for random ones.
    """
    count = round(about.period / configuration.step)
    running = np.ones(case.episodes, dtype=np.bool_)
    rows, actions, memory = [], [], None
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        chosen = {"integrator": configuration.integrator, "dtype": configuration.dtype, "substeps": count}
        options: dict[str, Any] = {**case.options, **chosen, "dt": about.period / count}
        envs = gymnasium.make_vec(case.env, num_envs=case.episodes, **options)
        inner: TaskVectorEnv = envs.unwrapped  # type: ignore[assignment]
        if drive is None:
            shape = (about.steps, *envs.action_space.shape)  # type: ignore[misc]
            drive = np.random.default_rng(case.seed).uniform(-1.0, 1.0, shape).astype(np.float32)
        observation, _ = envs.reset(seed=case.seed)
        for t in range(about.steps):
            if isinstance(drive, Controller):
                action, memory = drive.predict(observation, memory)
            else:
                action = drive[t]
            observation, reward, terminated, truncated, _ = envs.step(action)
            state = inner.snapshot()
            end = state.end_effector_pose()[:, :3, 3]
            rows.append((observation, reward, running, state.position, state.rotation, state.q, end))
            actions.append(action)
            # Instances whose episode is over start the next one, which does not count.
            running = running & ~(terminated | truncated)
        envs.close()
    observations, *others = (np.array(column) for column in zip(*rows, strict=True))
    warned = [str(warning.message) for warning in caught if issubclass(warning.category, StepWarning)]
    columns: tuple[Any, ...] = (np.array(actions), observations.astype(np.float64), *others, warned)
    return Recording(*columns)


def noise_deviation(case: Case, about: Frame, actions: NDArray[np.float32]) -> Floats:
    """Standard deviation (d,) of the sensor noise in every entry of an observation; 0 for entries without noise.

    It is measured: the same episodes with and without noise differ in nothing else. The noise is the environment's own,
    or the default of the component `noise` where the environment has none.
    """
    given = case.options.get("disturbance", gymnasium.registry[case.env].kwargs.get("disturbance"))
    if given is None:
        components: dict[str, Any] = {"current": {"speed": [0.0, case.options.get("max_current", 0.3)]}}
    else:
        components = {"base": given} if isinstance(given, str) else dict(given)
    base = components.get("base")
    level = disturbance_levels()[base].components if base in disturbance_levels() else {}
    own = components.get("noise", level.get("noise"))

    def run(noise: Any) -> Recording:
        disturbed = case._replace(options={**case.options, "disturbance": {**components, "noise": noise}})
        return record(disturbed, about, about.default, actions)

    quiet, noisy = run(None), run(True if own is None else own)
    both = quiet.running & noisy.running
    difference = (noisy.observations - quiet.observations)[both]
    return np.asarray(np.sqrt((difference**2).mean(axis=0)))
