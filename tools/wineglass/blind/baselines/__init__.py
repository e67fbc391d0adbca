"""Simpler ways to the same answers, in the same exam: what the diagnosis has to beat.

They learn from a training set with open labels, made by the same generator with another seed: more than the diagnosis is given. All see the same summary features.
Each says how much of a gap it sees and which effects; the threshold is set so that they have as many false gaps as the diagnosis."""
