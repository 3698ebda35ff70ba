"""Planning online: the goal is seen, a person does the task in the robot's mind, the robot does as that person does.

At the start of an episode the goal is looked for, as all policies do. A stand-in that is no more than that goal takes
the object's place; a clip of the task is planned there from where the robot stands (references.synthesis), retargeted,
and followed by the tracker. Nothing is learned but to see and to track. As the robot comes nearer and knows better
where its goal is, the plan goes there with it, slowly enough for feet to follow.
"""
