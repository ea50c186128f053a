"""Print the requirements of the package with the extras and dependency groups named, without the package itself."""

import sys
import tomllib
from pathlib import Path

file = tomllib.loads(Path("pyproject.toml").read_text())
named = file["project"]["optional-dependencies"] | file["dependency-groups"]
print(*file["project"]["dependencies"], *(line for name in sys.argv[1:] for line in named[name]), sep="\n")
