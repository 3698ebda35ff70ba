"""What each part of our tracker's training is worth: all of it, and without one thing, or with one more."""

from mimicbench.comparisons.spec import Comparison, Variant

_CALM = {"starts": {"pos_noise": 0.0, "angle_noise": 0.0, "vel_noise": 0.0}, "push": 0.0}

COMPARISON = Comparison(
    "tracker-parts",
    "our tracker with one part of its training taken away, or one more",
    "track",
    (
        Variant("as it is"),
        Variant("starts drawn evenly", {"track": {"tracking": {"focus": 0.0}}}),
        Variant("neither noise nor pushes", {"track": {"tracking": _CALM}}),
        Variant("assisting wrench", {"track": {"tracking": {"assist": 0.5}}}),
        Variant("mirrored clips", {"track": {"mirrored": True}}),
        Variant("contact labels", {"track": {"tracker": "residual-contact"}}),
        Variant("three frames", {"track": {"frames": 3}}),
        Variant("smoothed actions", {"track": {"settings": {"smoothing": 0.4}}}),
        Variant("price on power", {"track": {"settings": {"power": 1.0}}}),
        Variant("Muon", {"track": {"ppo": {"optimizer": "muon"}}}),
        Variant("small network", {"track": {"ppo": {"hidden": [128, 96]}}}),
    ),
)
