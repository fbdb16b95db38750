"""`make bench`: the package beside what else one would take, on the same work.

Each file of `workloads/` is one piece of work with its implementations side by side.
"""
