"""Options of tasks: the defaults of the dataclasses are those of the native module."""

from dataclasses import fields

import pytest

from uvms_gym._core import task_defaults, tasks
from uvms_gym._task.options import BATCH_OPTIONS, GROUPS, TaskOptions

#: Options that the native task does not have.
PYTHON = {"scene", "privileged", *BATCH_OPTIONS}


def test_every_task_has_its_dataclass() -> None:
    assert TaskOptions.by_task.keys() == {name for name, _ in tasks()}


@pytest.mark.parametrize("task", TaskOptions.by_task)
def test_defaults_are_those_of_the_native_module(task: str) -> None:
    native = task_defaults(task)
    options = TaskOptions.by_task[task]()
    assert {field.name for field in fields(options)} - PYTHON == native.keys() - {"task"}
    for name, value in options.to_dict().items():
        if name in GROUPS:
            assert value is None
            assert GROUPS[name].keys() == native[name].keys(), name
        elif name not in PYTHON:
            assert (value, type(value)) == (native[name], type(native[name])), name
