"""Programs from kernels: specialised for one scene, then interpreted or compiled."""
