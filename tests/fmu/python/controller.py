"""A PI controller with limits, as a slave for PythonFMU: a third party's FMU with signals of all types. What it remembers
from step to step is registered, because PythonFMU saves registered variables and nothing else."""
from pythonfmu import Boolean, Fmi2Causality, Fmi2Slave, Fmi2Variability, Integer, Real, String


class Controller(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.ref, self.y, self.enable, self.stage = 0.0, 0.0, True, 1
        self.u, self.limited, self.hits = 0.0, False, 0
        self.K, self.Ti, self.law = 2.0, 0.4, "PI"
        self.integral = 0.0
        inputs = {"ref": Real, "y": Real, "enable": Boolean, "stage": Integer}
        self._register(inputs, causality=Fmi2Causality.input)
        self._register({"u": Real, "limited": Boolean, "hits": Integer}, causality=Fmi2Causality.output)
        self._register({"K": Real, "Ti": Real}, causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable)
        self._register({"law": String}, causality=Fmi2Causality.parameter, variability=Fmi2Variability.fixed)
        self._register({"integral": Real}, causality=Fmi2Causality.local)

    def _register(self, variables, **attributes):
        for name, base_type in variables.items():
            self.register_variable(base_type(name, **attributes))

    def exit_initialization_mode(self):
        if self.law not in ("P", "PI"):
            raise ValueError(f"the law is 50 %s off, not P or PI: {self.law}")

    def do_step(self, current_time, step_size):
        error = self.ref - self.y
        if not self.enable:
            self.integral, self.u, self.limited = 0.0, 0.0, False
            return True
        wanted = self.stage * self.K * error + self.integral
        self.u = min(max(wanted, -1.0), 1.0)
        self.limited = self.u != wanted
        if self.limited:
            self.hits += 1
        elif self.law == "PI":
            self.integral += self.K * error * step_size / self.Ti
        return True
