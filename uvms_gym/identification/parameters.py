"""Parameters of a fit: keys of scene and map, their coordinates, priors and bounds."""

import copy
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from uvms_gym.identification import scene_keys
from uvms_gym.identification.recordings import Floats
from uvms_gym.identification.replay import Corrections

#: Start of keys of the map.
MAP = "map."
#: Standard deviations of priors by the end of a scene's key: of the logarithm (True), or of the value.
_PRIORS: tuple[tuple[str, bool, float], ...] = (
    (r"\.mass", True, 0.1),
    (r"\.(volume|buoyancy)", True, 0.2),
    (r"\.(rotational_inertia|inertia)(\[\d\])*", True, 1.0),
    (r"\.added_mass(\[\d\])*", True, 1.0),
    (r"\.damping(\.linear|\.quadratic)?(\[\d\])*", True, 2.0),
    (r"\.(center_of_mass|center_of_buoyancy|position)\[\d\]", False, 0.05),
    (r"\.rpy\[\d\]", False, 0.2),
    (r"\.water\.current\[\d\]", False, 0.1),
    (r"\.lag", True, 1.0),
)
#: The same for keys of a map.
_MAP_PRIORS: tuple[tuple[str, bool, float], ...] = (
    (r"joints\.axes\.[^.]+\.zero", False, 0.2),
    (r"(joints|thrusters|imu)\.time\.lag", False, 0.1),
    (r"thrusters\.axes(\.[^.]+)?\.scale", True, 0.3),
)
#: Bounds in standard deviations of the prior.
_REACH = 4.0


@dataclass(frozen=True)
class Parameter:
    """Free number of a scene or a map."""

    #: Key, see `scene_keys`; keys of the map begin with "map.".
    key: str
    #: Value of the scene or the map; 1 where the key names different numbers, which the parameter multiplies.
    start: float
    #: True for a positive number, whose coordinate is the logarithm.
    logarithmic: bool
    #: Standard deviation of the prior, in the coordinate.
    deviation: float
    #: Numbers of the scene at the key's places.
    numbers: tuple[float, ...] = ()

    @property
    def origin(self) -> float:
        """Coordinate of the start."""
        return math.log(self.start) if self.logarithmic else self.start

    @property
    def bounds(self) -> tuple[float, float]:
        """Minimum and maximum coordinate."""
        reach = _REACH * self.deviation
        return self.origin - reach, self.origin + reach

    def value(self, coordinate: float) -> float:
        """Value at a coordinate."""
        return math.exp(coordinate) if self.logarithmic else coordinate

    @property
    def factor(self) -> bool:
        """True where the value multiplies different numbers."""
        return len(set(self.numbers)) > 1


def make_parameters(
    scene: dict[str, Any],
    free: Sequence[str],
    map_data: Mapping[str, Any] | None = None,
    priors: Mapping[str, float] | None = None,
) -> list[Parameter]:
    """Parameters of keys.

    In `free`, `[a:b]` or a key of a list of numbers frees several. `map_data` is the map that the logs were read with,
    for the start of its keys (by default 0, and factors of 1). `priors` are standard deviations by key, relative for
    positive quantities.
    """
    given = dict(priors or {})
    found: dict[str, Parameter] = {}
    for key in free:
        names = [key] if key.startswith(MAP) else scene_keys.expand(scene, key)
        for name in names:
            if name in found:
                raise ValueError(f"{name!r} is given twice")
            parameter = _of_map(name, map_data or {}) if name.startswith(MAP) else _of_scene(scene, name, given)
            deviation = given.pop(name, given.get(key, parameter.deviation))
            if not deviation > 0.0:
                raise ValueError(f"prior of {name!r} is {deviation}, but must be > 0")
            found[name] = replace(parameter, deviation=float(deviation))
    if not found:
        raise ValueError("no parameter is free")
    if unknown := [key for key in given if key not in free]:
        raise ValueError(f"prior of {unknown[0]!r}, which is not free")
    return list(found.values())


def _of_scene(scene: dict[str, Any], key: str, given: Mapping[str, float]) -> Parameter:
    numbers = tuple(scene_keys.read(scene, key))
    logarithmic, deviation = _prior(key, _PRIORS, (all(n > 0.0 for n in numbers), 0.0))
    logarithmic = logarithmic or len(set(numbers)) > 1
    if deviation == 0.0 and key not in given:
        raise ValueError(f"{key!r} has no default prior; give one")
    start = numbers[0] if len(set(numbers)) == 1 else 1.0
    if logarithmic and not (start > 0.0 and any(numbers)):
        raise ValueError(f"{key!r} is {start:g}, but must be > 0 to be fitted: give a first guess in the scene")
    return Parameter(key, start, logarithmic, deviation, numbers)


def _of_map(key: str, data: Mapping[str, Any]) -> Parameter:
    name = key.removeprefix(MAP)
    found = _prior(name, _MAP_PRIORS, None)
    if found is None:
        raise ValueError(f"{key!r} cannot be fitted; zeros and lags and scales of a map can: map.joints.axes.NAME.zero")
    node: Any = data
    for step in name.split("."):
        node = node.get(step, {}) if isinstance(node, Mapping) else {}
    start = float(node) if isinstance(node, int | float) else 0.0
    # (A scale is a factor on the map's scale, whose sign stays.)
    return Parameter(key, 1.0 if found[0] else start, *found)


def _prior(key: str, priors: Sequence[tuple[str, bool, float]], default: Any) -> Any:
    return next((rest for pattern, *rest in priors if re.search(f"(^|\\b){pattern}$", key)), default)


def apply(
    scene: dict[str, Any],
    parameters: Sequence[Parameter],
    coordinates: Floats,
    joints: Sequence[str] = (),
    thrusters: Sequence[str] = (),
) -> tuple[dict[str, Any], Corrections]:
    """Scene and corrections of the logs at coordinates (p,).

    The given scene is not changed.
    """
    changed = copy.deepcopy(scene)
    zeros, scales, lags = np.zeros(len(joints)), np.ones(len(thrusters)), {}
    for parameter, coordinate in zip(parameters, coordinates):
        value = parameter.value(float(coordinate))
        if not parameter.key.startswith(MAP):
            scaled = parameter.logarithmic or parameter.factor
            numbers = [value / parameter.start * n for n in parameter.numbers] if scaled else [value]
            scene_keys.write(changed, parameter.key, numbers)
            continue
        channel, _, *rest = parameter.key.removeprefix(MAP).split(".")
        if rest == ["lag"]:
            lags[channel] = value - parameter.start
        elif channel == "joints":
            zeros[_index(parameter.key, rest[0], joints)] = value - parameter.start
        else:
            scales[_index(parameter.key, rest[0], thrusters) if len(rest) > 1 else slice(None)] *= value
    return changed, Corrections(zeros, scales, lags)


def _index(key: str, name: str, names: Sequence[str]) -> int:
    if name not in names:
        raise ValueError(f"{key!r}: the scene has no {name!r}, but {', '.join(names) or 'none'}")
    return list(names).index(name)
