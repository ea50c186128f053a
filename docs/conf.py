"""Sphinx configuration. `make docs` builds the site against the installed package."""

import logging
import sys
from pathlib import Path

from nbclient import NotebookClient

import uvms_gym

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

# One line per notebook.
logging.getLogger("traitlets").setLevel(logging.WARNING)
# Kernels warn that their connection, local TCP, is not encrypted.
NotebookClient.extra_arguments.default_args = (["--log-level=ERROR"],)

project = "uvms_gym"
author = "uvms_gym contributors"
copyright = "uvms_gym contributors, MIT license"
release = version = uvms_gym.__version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "command_line",
    "controllers",
    "environments",
    "pictures",
    "repository_links",
    "scenes",
    "scoreboard",
    "signatures",
]
exclude_patterns = ["_generated/**", "examples/**"]
source_suffix = {".md": "myst-nb"}

# Tutorials run whenever they are read; an exception ends the build.
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 600
nb_merge_streams = True

myst_enable_extensions = ["deflist"]
myst_heading_anchors = 4
suppress_warnings = [
    # Blocks show URDF, shell output and other texts without a lexer of their own.
    "misc.highlighting_failure",
]

# Docstrings put code in single backquotes.
default_role = "code"
# Documented without torch.
autodoc_mock_imports = ["stable_baselines3"]
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True}
# Options of commands keep their two hyphens.
smartquotes = False
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_use_ivar = True

html_theme = "furo"
html_title = "uvms_gym"
html_static_path = ["_static"]
html_css_files = ["uvms.css"]
html_show_sphinx = False
html_theme_options = {"navigation_with_keys": True}
