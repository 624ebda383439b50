"""Requirements for a driver, a damper model or a method, as tests that its author runs.

    pytest --pyargs rig.conformance --driver NAME      on the simulated rig, or --peer URL: the author's own peer
    pytest --pyargs rig.conformance --model NAME
    pytest --pyargs rig.conformance --method NAME

The options come with the pytest plug-in of this program; nothing in the program imports this package.
"""
