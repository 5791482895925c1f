"""Settings of the documentation: ``python -m sphinx -W docs build/docs``."""

from docutils.nodes import SkipNode
from latex2mathml.converter import convert

import jaxhb

project, author, copyright = "jaxhb", "The jaxhb developers", "The jaxhb developers"
release = version = jaxhb.__version__

extensions = ["myst_nb", "sphinx.ext.autodoc", "numpydoc", "sphinx.ext.viewcode"]
exclude_patterns = ["notebooks/.ipynb_checkpoints"]
highlight_language = "none"
html_theme = "furo"
html_title = f"jaxhb {release}"
html_math_renderer = "mathml"  # which browsers draw without a network

# The tests run the notebooks, the pages show the outputs that they keep
nb_execution_mode = "off"
myst_enable_extensions = ["dollarmath", "colon_fence"]
myst_heading_anchors = 3

autodoc_member_order = "bysource"
autodoc_class_signature = "separated"
autodoc_typehints = "none"
numpydoc_show_class_members = False
nitpicky = True
nitpick_ignore_regex = [
    ("py:.*", r"(?!jaxhb\.).*")
]  # types in the words of the docstrings; names of jaxhb are checked
linkcheck_timeout = 10


def setup(app):
    app.connect(
        "autodoc-process-docstring", equations_as_they_stand, priority=100
    )  # before numpydoc reads sections
    app.add_html_math_renderer("mathml", (_inline_math, None), (_displayed_math, None))


def equations_as_they_stand(app, what, name, obj, options, lines):
    """Indented equations of docstrings are literal blocks, so that their lines and bars
    stay.
    """
    text = [*lines, ""]
    head = next(
        (i - 1 for i, line in enumerate(text) if line and not line.strip("-")),
        len(lines),
    )
    begins = [
        i
        for i in range(2, head)
        if text[i].startswith("    ") and not text[i - 1] and text[i - 2][:1].strip()
    ]
    for i in reversed(begins):
        lines[i:i] = ["::", ""]


def _inline_math(translator, node):
    translator.body.append(convert(node.astext()))
    raise SkipNode


def _displayed_math(translator, node):
    translator.body.append(
        f'<div class="math">{convert(node.astext(), display="block")}</div>'
    )
    raise SkipNode
