"""Parts of the documentation site that Sphinx does not have; docs/conf.py names them."""
