"""How stiff a display may be: sampled-data stability and passivity from matrices and numbers."""
