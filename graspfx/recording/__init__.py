"""Write runs to disk and read them back."""
