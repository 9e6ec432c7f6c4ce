"""Extensions of Sphinx for the documentation site; docs/conf.py lists them."""
