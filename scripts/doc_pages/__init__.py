"""Pages of the documents that follow from the code: one module for each kind."""
