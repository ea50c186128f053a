"""Scripts in training/: they compile, also without their packages, and all.sh makes all that is shipped."""

import json
import os
import py_compile
import re
import subprocess
from pathlib import Path

import pytest
from helpers import policy

from uvms_gym.controllers.registry import PRETRAINED
from uvms_gym.training.finished import is_finished

TRAINING = Path(__file__).parents[2] / "training"
SCRIPTS = sorted(TRAINING.glob("*.py"))

#: Stand-in for `uvms` and `python`: notes its arguments, makes the file or the entry in gains.json, and fails with exit
#: status 130 at a call that has `$FAILING` in its arguments, with the settings of a run in its folder. Finished
#: files hold "policy".
STUB = """#!/bin/sh
[ "$1" = -c ] && exec grep -qs policy "$3"
echo "$@" >>calls
case "$*" in *"$FAILING"*) failing=1 ;; esac
while [ $# -gt 0 ]; do
    case $1 in
        -f) [ -z "${failing-}" ] || { mkdir -p "$2/algo/run_1" && echo {} >"$2/algo/run_1/config.json"; } ;;
        -i) [ -z "${failing-}" ] || exit 130 ;;
        --export) [ -n "${failing-}" ] || { mkdir -p "${2%/*}" && echo policy >"$2"; } ;;
        --policies) to=$2 ;;
        --controller) name=$2 ;;
        --env) task=${2%-*-v0} ;;
    esac
    shift
done
[ -z "${failing-}" ] || exit 130
[ -z "${to-}" ] && exit
mkdir -p "$to/$task/petasus-pum/0.1s"
printf ' "%s": {\\n' "$name" >>"$to/$task/petasus-pum/0.1s/gains.json"
"""


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.name)
def test_a_script_compiles(script: Path, tmp_path: Path) -> None:
    py_compile.compile(str(script), cfile=str(tmp_path / "compiled"), doraise=True)


def run_all(folder: Path, failing: str = "nothing") -> tuple[int, list[str]]:
    """Exit status of all.sh in a folder, and the calls of `uvms` and `python`; one with `failing` in it fails."""
    (folder / "bin").mkdir(exist_ok=True)
    for name in ("uvms", "python"):
        (folder / "bin" / name).write_text(STUB)
        (folder / "bin" / name).chmod(0o755)
    (folder / "calls").write_text("")
    path = os.pathsep.join([str(folder / "bin"), os.environ["PATH"]])
    ended = subprocess.run(
        ["sh", str(TRAINING / "all.sh"), "made"], cwd=folder, env=os.environ | {"PATH": path, "FAILING": failing}
    )
    return ended.returncode, (folder / "calls").read_text().splitlines()


def made(folder: Path) -> set[str]:
    """Policies, by file, and tuned controllers, by task, in a folder like `pretrained`."""
    policies = {str(path.relative_to(folder)) for path in folder.rglob("*.safetensors")}
    gains = {
        f"{path.relative_to(folder)}: {name}"
        for path in folder.rglob("gains.json")
        for name in re.findall(r'^ "([\w-]+)": \{$', path.read_text(), re.MULTILINE)
    }
    return policies | gains


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[str]]:
    """Folder of a run without interruption, and its calls."""
    folder = tmp_path_factory.mktemp("whole")
    status, calls = run_all(folder)
    assert status == 0
    return folder, calls


def test_all_that_is_shipped_is_made_once_and_kept(whole: tuple[Path, list[str]]) -> None:
    folder, calls = whole
    shipped = made(PRETRAINED)
    assert sum(":" in name for name in shipped) == sum(
        len(json.loads(path.read_text())) for path in PRETRAINED.rglob("gains.json")
    )
    assert shipped <= made(folder / "made")
    assert len(calls) == len(set(calls))
    assert run_all(folder) == (0, [])


@pytest.mark.parametrize("failing", ["--controller resolved ", "shac-distilled-calm-2-start"])
def test_an_interrupted_run_resumes_where_it_ended(failing: str, whole: tuple[Path, list[str]], tmp_path: Path) -> None:
    _, calls = whole
    status, first = run_all(tmp_path, failing)
    assert status == 130
    assert failing in first[-1]
    status, rest = run_all(tmp_path)
    assert (status, first[:-1] + rest[1:]) == (0, calls[: len(first) - 1] + calls[len(first) :])
    # A search resumes by the same command, a run by its folder.
    if "start" in failing:
        folder = "out/train/UVMS-StationKeep/shac-distilled-calm-2-start/algo/run_1"
        assert rest[0] == f"train --export out/train/{failing}.safetensors -i {folder}"
    else:
        assert rest[0] == first[-1]


def test_a_policy_that_a_full_disk_cut_off_is_made_again(whole: tuple[Path, list[str]]) -> None:
    folder, calls = whole
    file = folder / "made/UVMS-EETrack/petasus-pum/0.1s/shac-wide-3.safetensors"
    file.write_text("poli")
    assert run_all(folder) == (0, [call for call in calls if "shac-wide-3.safetensors" in call])
    assert file.read_text() == "policy\n"


def test_a_policy_is_finished_where_its_run_took_all_steps(tmp_path: Path) -> None:
    file = tmp_path / "policy.safetensors"
    assert not is_finished(file)
    notes = {"hyperparameters": json.dumps({"n_timesteps": 6_000_000})}
    for steps, finished in (("369152", False), ("6000000", True), ("6000640", True)):
        policy(notes={**notes, "steps": steps}).save(file)
        assert is_finished(file) is finished
    file.write_bytes(file.read_bytes()[:-1])
    assert not is_finished(file)
    policy().save(file)
    assert not is_finished(file)
    assert all(is_finished(path) for path in PRETRAINED.rglob("*.safetensors"))
