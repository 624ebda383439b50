"""Independent jobs that run in this process, in local processes, or on a Dask cluster.

A command describes its jobs once (`Job`) and receives their results from any `Workers` as they arrive. Data for many
jobs are transferred once (`Workers.share`) or read from files (`Workers.check_files`), and never sent with each job.
This package does not depend on what a job computes.
"""
