"""What the solver is measured against."""
