"""Episode that goes on while its conditions, target and controller change."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uvms_gym.controllers.families import canonical
from uvms_gym.disturbances import disturbance_levels
from uvms_gym.envs.base import TaskEnv
from uvms_gym.envs.rendering import Shot, shots
from uvms_gym.studies.comparison.conditions import SCALED
from uvms_gym.studies.comparison.own import make_controller

Floats = NDArray[np.float64]
#: Position (3,), m, and unit quaternion [w, x, y, z], (4,), in the world.
Target = tuple[Floats, Floats]
#: Target at the world's origin, level.
HOME: Target = (np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
#: Maximum factor of a disturbance, and maximum steady current, m/s, and payload, kg, of the page; the minima are 0.
MAXIMA = {"strength": 2.0, "current": 1.0, "payload": 5.0}
#: Maximum seed.
MOST_SEED = 2**64 - 1
#: Parameters of a disturbance that go with its strength. The steady current has its own control; sensors, the arm's
#: motion and the scatter of parameters stay.
_SCALED = {name: keys for name, keys in SCALED.items() if name not in ("current", "arm")}


@dataclass(frozen=True)
class Conditions:
    """Factor on a disturbance, speed of the steady current, m/s, and constant payload at the end effector, kg."""

    strength: float = 1.0
    current: float = 0.2
    payload: float = 0.0

    def __post_init__(self) -> None:
        for name, maximum in MAXIMA.items():
            if not 0.0 <= (value := getattr(self, name)) <= maximum:
                raise ValueError(f"{name} is {value:g}, but must be 0 to {maximum:g}")

    def disturbance(self, components: dict[str, Any]) -> dict[str, Any]:
        """Components of a disturbance under these conditions.

        `components` have the form of the option `disturbance`, without `base`.
        """
        changed = {name: dict(entry) if isinstance(entry, dict) else entry for name, entry in components.items()}
        changes: dict[tuple[str, str], Callable[[float], float]] = {
            (name, key): lambda x: self.strength * x for name, keys in _SCALED.items() for key in keys
        }
        changes["thrusters", "gain"] = lambda x: max(0.0, 1.0 - self.strength * (1.0 - x))
        for (name, key), change in changes.items():
            if changed.get(name) and (value := changed[name].get(key)) is not None:
                # A number, or both ends of a range.
                several = isinstance(value, list | tuple)
                changed[name][key] = [change(x) for x in value] if several else change(value)
        changed["current"] = {**changed.get("current", {}), "speed": self.current}
        changed["parameters"] = {**changed.get("parameters", {}), "payload": [self.payload, self.payload]}
        return changed


class LiveEpisode:
    """One instance of a task under a controller, always with a disturbance.

    A change of conditions or target begins a new episode of the same seed from the present state: draws of a
    disturbance belong to the start of an episode.

    `env` gives the options of an environment that is made under a disturbance: the level named in them, or the storm.
    `controller` is FAMILY, FAMILY/SETTING, `mlp:FILE` or `py:FILE:NAME`. A ValueError refuses controller or seed.
    """

    def __init__(self, env: TaskEnv, controller: str, seed: int) -> None:
        own = env.options.disturbance
        self.level = own if isinstance(own, str) and own else "storm"
        self.components = disturbance_levels()[self.level].components
        # The middle of the level's speeds.
        speed = self.components.get("current", {}).get("speed", 0.0)
        self.conditions, self.seed = Conditions(current=round(float(np.mean(speed)), 2)), seed
        self.env = type(env)(env.options, disturbance=self.conditions.disturbance(self.components))
        self.period: float = self.env.control_period
        self.target = HOME
        self.choose(controller)
        self.reset()

    def choose(self, controller: str) -> None:
        """Continue the episode with another controller, whose memory is empty."""
        name = canonical(controller, task=self.env.task)
        self._control = make_controller(name, self.env)
        self.controller = name
        self._memory: Any = None

    def reset(self, seed: int | None = None, target: Target | None = None) -> None:
        """Begin anew from the start that the seed draws, with another target if one is given."""
        seed = self.seed if seed is None else seed
        if not 0 <= seed <= MOST_SEED:
            raise ValueError(f"seed is {seed}, but must be 0 to {MOST_SEED}")
        self._begin(self.conditions, self.target if target is None else target, seed, {})
        self.time = 0.0

    def change(self, target: Target | None = None, **conditions: float) -> None:
        """Begin an episode under other conditions, or with another target, from the present state."""
        now = self.env.snapshot()
        start = {"position": now.position, "attitude": now.quaternion, "twist": now.twist, "q": now.q, "qd": now.qd}
        target = self.target if target is None else target
        start = {name: rows[0] for name, rows in start.items() if rows.size}
        self._begin(replace(self.conditions, **conditions), target, self.seed, start)

    def _begin(self, conditions: Conditions, target: Target, seed: int, start: dict[str, Floats]) -> None:
        given: dict[str, Any] = {**start, "target_position": target[0], "target_attitude": target[1]}
        given["disturbance"] = conditions.disturbance(self.components)
        self._observation, self.info = self.env.reset(seed=seed, options=given)
        self.conditions, self.target, self.seed, self._memory = conditions, target, seed, None
        self.before = self.after = self._shot()

    def step(self) -> bool:
        """One control period; False where the run diverged and the episode began anew."""
        action, self._memory = self._control.predict(self._observation, self._memory)
        self._observation, _, terminated, _, self.info = self.env.step(action)
        if terminated:
            self.reset()
            return False
        self.time += self.period
        self.before, self.after = self.after, self._shot()
        return True

    def _shot(self) -> Shot:
        """State to draw, with poses in the world.

        `poses` (n + 2, 4, 4) are of bodies and end effector, `fixtures` (F, 4, 4) of the fixtures; `aim` (4, 4) is the
        desired pose of the vehicle, or of the end effector where the task is its own.
        """
        simulator, shot = self.env.snapshot(), shots(self.env._native)
        poses = np.concatenate([simulator.body_poses(), simulator.end_effector_pose()[:, None]], axis=1)
        fixtures = simulator.fixture_poses()
        aim = next(shot[name] for name in ("point", "dock", "target") if name in shot)
        return {name: rows[0] for name, rows in {**shot, "poses": poses, "fixtures": fixtures, "aim": aim}.items()}
