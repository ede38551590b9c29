"""Sphinx configuration; nothing in it needs the network."""

import importlib.metadata
import re

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.util.inspect import TypeAliasForwardRef

project = "Sensorless"
author = "The Sensorless authors"
copyright = f"2026, {author}"
release = importlib.metadata.version("sensorless")

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.viewcode"]
exclude_patterns = ["_build", "jupyter_execute"]

html_theme = "furo"
html_title = f"{project} {release}"
html_static_path = ["_static"]
html_css_files = ["pages.css"]
# Formulas are made into MathML here, which browsers draw by themselves; MathJax would have to be fetched.
html_math_renderer = "mathml"

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
# In a union such as ``FloatArray | None`` Sphinx would show its own class around the name.
TypeAliasForwardRef.__repr__ = lambda alias: alias.name
# Attributes of a dataclass stand in its docstring; listed as members too they would be there twice.
napoleon_use_ivar = True
napoleon_google_docstring = True
napoleon_numpy_docstring = False


def plain_bars(app, what, name, obj, options, lines):
    """Keep ``|x|`` in a docstring a magnitude; Sphinx would look for a substitution."""
    lines[:] = [line.replace("|", r"\|") for line in lines]


def one_name_each(app, what, name, obj, options, lines):
    """Give each of ``lower, upper: text`` an entry of its own; Napoleon would take the first name for a type."""
    if what in ("data", "attribute") and lines:
        lines[0] = lines[0].replace(": ", "; ")  # what is before a colon would be its type
    written = []
    for line in lines:
        several = re.match(r"( +)(\w+(?:, \w+)+): (.*)", line)
        if several:
            indent, names, text = several.groups()
            *before, last = names.split(", ")
            written += [f"{indent}{one}: see ``{last}``." for one in before]
            line = f"{indent}{last}: {text}"
        written.append(line)
    lines[:] = written


def mathml(translator, node):
    """Write a formula as MathML; a size of brackets is left to the browser."""
    block = isinstance(node, nodes.math_block)
    formula = tex2mathml(re.sub(r"\\[bB]igg?(?![a-zA-Z])", "", node.astext()), as_block=block)
    # as accents, dots are drawn into the letter below
    formula = formula.replace(' accent="true"', "")
    if block:
        formula = f'<div class="math" style="overflow-x: auto; margin: 1em 0">{formula}</div>'
    translator.body.append(formula)
    raise nodes.SkipNode


def setup(app):
    app.add_html_math_renderer("mathml", inline_renderers=(mathml, None), block_renderers=(mathml, None))
    # before and after Napoleon, which has 500
    app.connect("autodoc-process-docstring", one_name_each, priority=400)
    app.connect("autodoc-process-docstring", plain_bars, priority=900)
