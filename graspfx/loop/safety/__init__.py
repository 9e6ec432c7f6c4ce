"""The safety chain between law and devices; its reduced forces also act on the object."""
