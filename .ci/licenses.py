"""Write the licence texts of all crates that the native module links, for the wheel (pyproject.toml: license-files)."""

import json
import re
import subprocess
import tomllib
from pathlib import Path

PACKAGE = "uvms-gym-python"
NAME = re.compile(r"(licen[cs]e|copying|notice|unlicense)", re.IGNORECASE)


def cargo(*arguments: str) -> str:
    """Output of a command of cargo."""
    return subprocess.run(["cargo", *arguments, "--locked"], check=True, stdout=subprocess.PIPE, text=True).stdout


def main() -> None:
    """Gather the texts; each once, after the crates that have it."""
    files = tomllib.loads(Path("pyproject.toml").read_text())["project"]["license-files"]
    out = Path(next(file for file in files if file.startswith("target/")))
    tree = cargo("tree", "--package", PACKAGE, "--edges", "normal,no-proc-macro", "--prefix", "none", "--format", "{p}")
    linked = {tuple(line.split()[:2]) for line in tree.splitlines() if line}
    rustc = subprocess.run(["rustc", "-vV"], check=True, stdout=subprocess.PIPE, text=True).stdout
    host = next(line.removeprefix("host: ") for line in rustc.splitlines() if line.startswith("host: "))
    packages = json.loads(cargo("metadata", "--format-version", "1", "--filter-platform", host))["packages"]
    crates: dict[str, list[str]] = {}
    for package in packages:
        if (package["name"], f"v{package['version']}") not in linked or package["source"] is None:
            continue
        folder, name = Path(package["manifest_path"]).parent, f"{package['name']} {package['version']}"
        texts = sorted(file for file in folder.iterdir() if file.is_file() and NAME.match(file.name))
        if not texts:
            raise SystemExit(f"{name} ({package['license']}) has no licence text in {folder}")
        for text in texts:
            crates.setdefault(text.read_text(encoding="utf-8").strip(), []).append(f"{name} ({package['license']})")
    head = "Crates that the native module of uvms_gym links, besides Rust's standard library (MIT OR Apache-2.0)."
    parts = [f"{'=' * 80}\n{', '.join(dict.fromkeys(names))}\n\n{text}" for text, names in crates.items()]
    out.parent.mkdir(exist_ok=True)
    out.write_text("\n\n".join([head, *parts]) + "\n", encoding="utf-8")


main()
