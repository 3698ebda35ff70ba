"""Networks of learners, one file each. What can be set of them is beside the learner."""
