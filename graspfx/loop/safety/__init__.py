"""Safety chain between coupling law and devices; the forces that it reduces also act, reduced, on the object."""
