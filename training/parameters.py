"""Tuned parameters of each controller, and their ranges."""

from collections.abc import Sequence
from typing import NamedTuple

from search import Space

from uvms_gym.controllers.families import names

#: Names of a parameter's entries, by their number.
NAMES = {2: ("linear", "angular"), 3: ("linear", "angular", "joints"), 6: ("x", "y", "z", "roll", "pitch", "yaw")}
Groups = tuple[tuple[int, ...], ...]
#: Axes of the vehicle that share a factor.
ALIKE: Groups = ((0, 1), (2,), (3, 4), (5,))
EACH: Groups = tuple((axis,) for axis in range(6))

#: Gains that are not sought: the wrist turns the valve, not the vehicle, which rolled by up to 85 degrees otherwise.
PRESCRIBED = {"valve": {"posture_gain": 0.04, "levelling_gain": 5.0, "arm_weight": 1.0}}


class Parameter(NamedTuple):
    """A keyword argument of a controller, and its range.

    The range is of factors on the controller's default, one factor per group of its entries, or of the value itself
    where `absolute`. The lower end of a range with a `floor` is practically zero: the optimum may lie there.
    """

    name: str
    low: float
    high: float
    groups: Groups = ()
    absolute: bool = False
    floor: bool = False

    @property
    def labels(self) -> list[str]:
        """Names of the factors or values."""
        names = NAMES.get(sum(map(len, self.groups)), ())
        return [f"{self.name}[{','.join(names[i] for i in group)}]" for group in self.groups] or [self.name]


def parameters(axes: Groups, task: str = "station-keep") -> dict[str, tuple[Parameter, ...]]:
    """Parameters by the controller's name for a task; gains on the vehicle have one factor per group of `axes`."""
    pd = (Parameter("kp", 0.2, 20.0, axes), Parameter("kd", 0.2, 10.0, axes))
    horizon = Parameter("prediction_horizon", 0.01, 1.0, absolute=True, floor=True)
    observer = Parameter("observer_bandwidth", 0.2, 20.0, ((0,), (1,)), absolute=True)
    # Disturbance model of the observer.
    expected = (
        Parameter("wave_acceleration", 0.003, 3.0, ((0,), (1,)), absolute=True, floor=True),
        Parameter("wave_frequency", 0.3, 4.0, absolute=True),
        Parameter("acceleration_noise", 0.001, 1.0, ((0,), (1,)), absolute=True, floor=True),
    )
    schedule = Parameter("delay_schedule", 0.1, 30.0, ((0,), (1,)), absolute=True, floor=True)
    innovation = Parameter("innovation", 0.01, 3.0, ((0,), (1,)), absolute=True)
    factors = Parameter("thrust_factors", 0.3, 3.0, ((0,), (1,), (2,)), absolute=True)
    memory = Parameter("memory_time", 0.3, 30.0, absolute=True)
    weights = (
        Parameter("velocity", 0.001, 1.0, ((0,), (1,)), absolute=True, floor=True),
        Parameter("effort", 1e-6, 0.1, ((0,), (1,)), absolute=True, floor=True),
        Parameter("change", 1e-6, 0.1, ((0,), (1,)), absolute=True, floor=True),
    )
    resolved = (
        *(Parameter(name, 0.1, 10.0) for name in ("pose_gain", "twist_gain", "joint_gain")),
        *(Parameter(name, 0.02, 20.0) for name in ("posture_gain", "levelling_gain", "arm_weight")),
    )
    if task in PRESCRIBED:
        resolved = tuple(parameter for parameter in resolved if parameter.name not in PRESCRIBED[task])
    three: Groups = ((0,), (1,), (2,))
    resolved_dob = (*resolved, observer._replace(groups=three), horizon._replace(name="lag_compensation"))
    # A tool that works on a fixture.
    given_way = Parameter("compliance", 1e-4, 0.02, absolute=True, floor=True)
    compliance = (given_way,) if task in ("button", "valve") else ()
    nmpc = {
        "station-keep": (*weights, observer, *expected),
        "ee-track": (
            *(weight._replace(groups=three) for weight in weights[:2]),
            weights[2],
            Parameter("posture", 1e-6, 0.01, absolute=True, floor=True),
            Parameter("levelling", 1e-6, 0.1, absolute=True, floor=True),
            observer._replace(groups=three),
        ),
    }
    found = {
        "pd": pd,
        "pd-restoring": pd,
        "pid": (*pd, Parameter("ki", 0.05, 20.0, axes)),
        "dob/plain": (*pd, observer, *expected),
        "dob": (*pd, observer, *expected, horizon),
        "dob-adaptive": (*pd, observer, *expected, horizon, schedule, factors, innovation, memory),
        "computed-torque": (*pd, observer, *expected, horizon),
        "mpc": (*weights, observer, *expected),
        "nmpc": nmpc.get(task, ()),
        "resolved": resolved,
        "resolved-pid": (*resolved, Parameter("integral_gain", 0.01, 10.0, absolute=True)),
        "resolved-dob": (*resolved_dob, *compliance),
        "resolved-adaptive": (
            *resolved_dob,
            schedule._replace(low=0.01, high=3.0),
            innovation._replace(groups=three),
            factors,
            memory,
        ),
    }
    # All settings of a family, where they have no entry of their own.
    known = {name: found.get(name, found.get(name.partition("/")[0], ())) for name in names(task, learned=False)}
    return {name: sought for name, sought in known.items() if sought}


def space_of(sought: Sequence[Parameter]) -> Space:
    """Search space of parameters."""
    return Space(*zip(*((label, p.low, p.high, p.floor) for p in sought for label in p.labels)))
