"""What the tables of a scene describe, made: shapes, bodies, hands, devices, the servo."""
