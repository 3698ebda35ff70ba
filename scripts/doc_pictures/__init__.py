"""What the pictures of the documents show, and how each is drawn."""
