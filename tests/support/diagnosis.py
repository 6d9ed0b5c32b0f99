"""Estimates properties of the plant from the corrections of a locked twin, in the rows of `replay --csv`."""

WATT_PER_PERCENT = {"1": 6.388e-3, "2": 3.264e-3}  # alpha1, alpha2 of fmus/tclab
SENSOR_LAG = 16  # s, its tau, to the nearest step of 1 s


def slope(x, y):
    """The slope of the regression line of y on x."""
    mean_x, mean_y = sum(x) / len(x), sum(y) / len(y)
    covariance = sum((a - mean_x) * (b - mean_y) for a, b in zip(x, y))
    return covariance / sum((a - mean_x) ** 2 for a in x)


def corrections(rows, variable):
    """u minus nominal in each step."""
    return [u - nominal for u, nominal in zip(rows[variable], rows[f"{variable} nominal"])]


def excess_heat_capacity(rows, heater):
    """The excess heat capacity of a twin of TCLab, J/K: added heat over the heater's temperature, which the sensor shows one time
    constant later. Steps are 1 s."""
    heat, added = 0.0, []
    for correction in corrections(rows, f"board.Q{heater}"):
        heat += WATT_PER_PERCENT[heater] * correction
        added.append(heat)
    return slope(rows[f"plant.T{heater}"][SENSOR_LAG:], added[:-SENSOR_LAG])


def mean_where_adjusted(rows, variable):
    """The mean of the corrections that are not 0; a variable without effect at times stays at nominal then."""
    found = [correction for correction in corrections(rows, variable) if correction]
    return sum(found) / len(found)
