"""Policies as they are judged: many robots at once, from their own senses alone; ours and other people's."""
