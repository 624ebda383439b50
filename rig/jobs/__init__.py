"""Independent jobs, and where they run: in this process, in processes of this machine, or on a Dask cluster.

A command describes its jobs once (`Job`) and takes their results as they come from any `Workers`. What many jobs need
is handed over once (`Workers.share`) or read from files (`Workers.check_files`), never sent with each job. Nothing here
knows what a job computes.
"""
