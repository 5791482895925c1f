"""Settings of the documentation: ``python -m sphinx -W docs build/docs``."""

import jaxhb

project, author, copyright = "jaxhb", "The jaxhb developers", "The jaxhb developers"
release = version = jaxhb.__version__

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.mathjax", "sphinx.ext.viewcode"]
exclude_patterns = ["notebooks/.ipynb_checkpoints"]
html_theme = "furo"
html_title = f"jaxhb {release}"

nb_execution_mode = "off"  # the tests run the notebooks, the pages show the outputs that they keep
myst_enable_extensions = ["dollarmath", "colon_fence"]
myst_heading_anchors = 3

autodoc_member_order = "bysource"
autodoc_class_signature = "separated"
autodoc_typehints = "none"
napoleon_google_docstring = False
napoleon_use_rtype = False
nitpicky = True
nitpick_ignore_regex = [("py:.*", r"(?!jaxhb\.).*")]  # types in the words of the docstrings; names of jaxhb are checked
linkcheck_timeout = 10


def setup(app):
    app.connect("autodoc-process-docstring", equations_as_they_stand, priority=100)  # before napoleon reads sections


def equations_as_they_stand(app, what, name, obj, options, lines):
    """Indented equations of docstrings are literal blocks, so that their lines and bars stay."""
    text = [*lines, ""]
    head = next((i - 1 for i, line in enumerate(text) if line and not line.strip("-")), len(lines))
    begins = [i for i in range(2, head) if text[i].startswith("    ") and not text[i - 1] and text[i - 2][:1].strip()]
    for i in reversed(begins):
        lines[i:i] = ["::", ""]
