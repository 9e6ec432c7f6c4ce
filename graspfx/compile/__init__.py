"""From kernels to a program: specialised for one scene, interpreted as it is or compiled."""
