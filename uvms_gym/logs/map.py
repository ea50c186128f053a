"""Map of logs: start and end of a trial, and its channels."""

import math
import os
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from uvms_gym._files import read_text
from uvms_gym.logs.channel_map import QUANTITIES, ChannelMap, channel_map
from uvms_gym.logs.errors import reading
from uvms_gym.logs.keys import Keys

#: Longest interval between samples that is interpolated, s.
GAP = 0.5
#: Place of the trial's name in names of files.
TRIAL = "{trial}"
_AXES = ("x", "y", "z")


@dataclass(frozen=True)
class Bound:
    """Start or end of a trial: a time, a key of a file, or the first sample whose position passes a limit."""

    #: Time on the log's clock, s.
    time: float | None = None
    #: File of lines "key: value", in whose name "{trial}" is replaced, and the key whose value is the time, s.
    file: str | None = None
    key: str | None = None
    #: Axis of the position, in the library's world axes.
    axis: int = 2
    #: Limits of the position, m.
    above: float = math.inf
    below: float = -math.inf


@dataclass(frozen=True)
class LogMap:
    """Map from files or bags to the channels of logs."""

    #: Name of the map's file, for errors.
    name: str
    #: Name of the bag, in which "{trial}" is replaced; None: the path that is read is the bag.
    bag: str | None
    #: Zero of the log's clock at its first sample; otherwise the zero of the stamps.
    first: bool
    #: Start of the trial, within the samples that all channels share.
    start: Bound
    #: End of the trial, within the same samples.
    end: Bound
    #: Channels by name.
    channels: Mapping[str, ChannelMap]
    #: Maps of trials with keys of their own.
    trials: Mapping[str, "LogMap"] = field(default_factory=dict)

    @classmethod
    def read(cls, source: "str | os.PathLike[str] | Mapping[str, Any] | LogMap") -> "LogMap":
        """Read a map from a TOML file, or from the same data as a dict; a map is returned as it is.

        Raises
        ------
        LogError
            The message names file, key and value.
        """
        if isinstance(source, LogMap):
            return source
        if isinstance(source, Mapping):
            return _log_map(source, "map")
        with reading(source):
            return _log_map(tomllib.loads(read_text(source)), os.fspath(source))

    def of(self, trial: str | None) -> "LogMap":
        """Map of a trial: with the keys of its table in place of the general ones."""
        return self.trials.get(trial or "", self)

    @property
    def patterns(self) -> list[str]:
        """Names of all files and bags of a trial, in which "{trial}" is replaced."""
        names = [self.bag, *(channel.file for channel in self.channels.values()), self.start.file, self.end.file]
        return list(dict.fromkeys(name for name in names if name))

    @property
    def by_trial(self) -> bool:
        """True where names of files contain the trial's name; otherwise a directory or a bag is one trial."""
        return any(TRIAL in name for name in self.patterns)


def _log_map(data: Mapping[str, Any], name: str) -> LogMap:
    general = {key: value for key, value in data.items() if key != "trial"}
    found = _one_map(general, name)
    table = Keys(data, name).table("trial")
    trials = {}
    for trial in table:
        own = table.table(trial).data
        trials[trial] = _one_map(_merged(general, own), f'{name} with [trial."{trial}"]')
    return replace(found, trials=trials)


def _merged(general: Mapping[str, Any], own: Mapping[str, Any]) -> dict[str, Any]:
    """Data with other values: tables key by key, start and end as a whole."""
    merged = dict(general)
    for key, value in own.items():
        old = merged.get(key)
        tables = isinstance(old, Mapping) and isinstance(value, Mapping) and key not in ("start", "end")
        merged[key] = _merged(merged[key], value) if tables else value
    return merged


def _one_map(data: Mapping[str, Any], name: str) -> LogMap:
    keys = Keys(data, name)
    gap = keys.number("gap", GAP, above=0.0, finite=False)
    found = LogMap(
        name=name,
        bag=keys.text("bag") if keys.has("bag") else None,
        first=keys.choice("clock", ("stamps", "first"), "stamps") == "first",
        start=_bound(keys, "start"),
        end=_bound(keys, "end"),
        channels={kind: channel_map(kind, keys.table(kind), gap) for kind in QUANTITIES if keys.has(kind)},
    )
    keys.has("trial")
    keys.finish()
    if not found.channels:
        raise keys.error(None, f"no channel; known: {', '.join(QUANTITIES)}")
    if found.bag and not any(channel.topic for channel in found.channels.values()):
        raise keys.error("bag", "no channel has a topic")
    limits = {found.start.above, found.start.below, found.end.above, found.end.below}
    if "pose" not in found.channels and limits != {math.inf, -math.inf}:
        raise keys.error(None, "a start or an end by position needs the channel pose")
    return found


def _bound(keys: Keys, key: str) -> Bound:
    value = keys.value(key)
    if value is None:
        return Bound()
    if not isinstance(value, Mapping):
        return Bound(time=keys.number(key, 0.0))
    table = keys.table(key)
    if table.has("file"):
        bound = Bound(file=table.text("file"), key=table.text("key"))
    else:
        axis = table.choice("position", _AXES)
        table.require("above", "below")
        bound = Bound(
            axis=_AXES.index(axis), above=table.number("above", math.inf), below=table.number("below", -math.inf)
        )
    table.finish()
    return bound
