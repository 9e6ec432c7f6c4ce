"""The safety chain between law and devices, whose result the object receives, too."""
