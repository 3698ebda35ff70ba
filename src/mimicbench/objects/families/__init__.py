"""The parametric families of objects, one file each, and what their makers share."""
