"""The commands of `mimicbench`, a module for each group.

Everything heavy is imported inside the commands, so that help is quick.
"""
