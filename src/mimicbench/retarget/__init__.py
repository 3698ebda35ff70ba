"""Human motion to robot motion: one file per method, the joint mapping, the measures."""
