"""Sphinx configuration; nothing in it needs the network."""

import importlib.metadata

project = "Sensorless"
author = "The Sensorless authors"
copyright = f"2026, {author}"
release = importlib.metadata.version("sensorless")

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.viewcode"]
exclude_patterns = ["_build", "jupyter_execute"]

html_theme = "furo"
html_title = f"{project} {release}"

myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3

# Pages with code are run when their code or what it printed has changed; one that fails stops the build.
nb_execution_mode = "cache"
nb_execution_raise_on_error = True
nb_execution_timeout = 300
nb_merge_streams = True
# Attributes called ``name`` stand in many classes; which of them a docstring means is told by where it stands.
suppress_warnings = ["ref.python"]

autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
autodoc_default_options = {"members": True, "exclude-members": "model_config"}
autodoc_type_aliases = {name: name for name in ("FloatArray", "IntArray", "BoolArray", "Array")}
# Attributes of a dataclass stand in its docstring; listed as members too they would be there twice.
napoleon_use_ivar = True
napoleon_google_docstring = True
napoleon_numpy_docstring = False


def plain_bars(app, what, name, obj, options, lines):
    """Keep ``|x|`` in a docstring a magnitude; Sphinx would look for a substitution."""
    lines[:] = [line.replace("|", r"\|") for line in lines]


def setup(app):
    app.connect("autodoc-process-docstring", plain_bars, priority=900)
