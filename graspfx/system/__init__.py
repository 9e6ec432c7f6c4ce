"""Things that operating systems do each in their own way: a module for each, with the answer of those that cannot."""
