"""Tables of models on trajectories: definitions as YAML, cells that resume, a page and MLflow.

A table compares models, each trained and tested on each of several data sets. `definition` is the record of
one, `datasets` its trajectories, `worker` trains and measures, `rows` are the numbers and their page, and
`table` is the folder of the results.
"""
