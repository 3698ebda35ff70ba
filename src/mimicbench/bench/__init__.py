"""How fast the parts are, and whether they hold out."""
