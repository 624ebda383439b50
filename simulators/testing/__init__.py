"""A lab's own tests on the simulated rig: fixtures of a pytest plug-in, campaigns in virtual time, a rig on real wires.

Nothing else of the project imports this package, and only `pytest_plugin` needs pytest.
"""
