"""What lines of sight meet of objects, in closed form, and what cameras see by them."""
