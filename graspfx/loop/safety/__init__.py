"""The safety chain between coupling law and devices; its reduced forces also act on the object."""
