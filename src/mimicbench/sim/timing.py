"""How time passes: known without MuJoCo."""

PHYSICS_DT = 0.005
"""[s] 200 Hz."""
SUBSTEPS = 4
"""Physics steps per control step: 50 Hz control."""
CONTROL_DT = PHYSICS_DT * SUBSTEPS
