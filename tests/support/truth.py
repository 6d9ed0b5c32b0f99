"""The true error of a twin of our own plant: compared with the plant's FMUs, without noise, at every step."""
from twinlock_test import edited_config, read_config, read_table, run_well, scratch


def make_truth(plant, edits=None):
    """The table of a plant's configuration, with `edits`: a row for each step, without noise."""
    columns = read_config(plant)["emulate"]["columns"]
    exact = {"emulate": {"columns": {name: {"noise": None} for name in columns}, "message_s": None}}
    made = scratch() / "truth.csv"
    document = edited_config(edited_config(plant, edits), exact)
    run_well(["plant", document, "--record", made, "--seed", "1"])
    return read_table(made)


def true_mse(rows, variable, truth, column, step_s):
    """The mean square of `variable` in a replay's rows (replay_csv()) minus the true `column` at the same instant."""
    time = next(name for name in truth if name in ("t", "time"))
    true = {round(at / step_s): value for at, value in zip(truth[time], truth[column])}
    squares = [(value - true[round(at / step_s)])**2 for at, value in zip(rows["time"], rows[variable])
               if round(at / step_s) in true]
    return sum(squares) / len(squares)
