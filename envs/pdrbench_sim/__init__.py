"""The simulator: synthetic buildings, people who walk through them, and what their sensors measure.

`buildings` draws buildings; `people` plans routes through any building and walks them; `foot` and `phone` move a unit;
`units`, `fields` and `radio` give what it measures; `record` puts all of it together; `realism` compares the outcome
with recordings. Import the submodules: they need SciPy and shapely.
"""

COMMANDS = {
    "error-model": "pdrbench_sim.units.command:error_model",
    "validate-sim": "pdrbench_sim.realism.command:validate_sim",
}

BENCHES = {"simulate": "pdrbench_sim.bench:run"}
