"""The viewer: a local page in the browser on objects, clips and episodes, and on policies while they act."""
