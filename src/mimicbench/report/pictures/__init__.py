"""What a report shows: one episode through all stages, failures, objects."""
