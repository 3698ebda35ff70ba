"""Physics-based motion tracking: from retargeted clips to physically real ones."""
