"""A first-order plant behind a valve, as a slave for PythonFMU: y follows gain·u with the time constant T while the valve is
open, and 0 while it is not. The number of times that y has gone above `threshold` is an Integer."""
from math import exp

from pythonfmu import Boolean, Fmi2Causality, Fmi2Slave, Fmi2Variability, Integer, Real


class Plant(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.u, self.open, self.y, self.above, self.count = 0.0, True, 0.0, False, 0
        self.gain, self.T, self.threshold = 1.0, 0.3, 0.5
        self.register_variable(Real("u", causality=Fmi2Causality.input))
        self.register_variable(Boolean("open", causality=Fmi2Causality.input))
        self.register_variable(Real("y", causality=Fmi2Causality.output))
        self.register_variable(Boolean("above", causality=Fmi2Causality.output))
        self.register_variable(Integer("count", causality=Fmi2Causality.output))
        for name in "gain", "T", "threshold":
            self.register_variable(Real(name, causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable))

    def do_step(self, current_time, step_size):
        aim = self.gain * self.u if self.open else 0.0
        self.y = aim + (self.y - aim) * exp(-step_size / self.T)
        rises = self.y > self.threshold and not self.above
        self.above = self.y > self.threshold
        self.count += rises
        return True
