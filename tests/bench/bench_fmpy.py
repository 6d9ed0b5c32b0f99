"""The free and the synchronised step of bench.c's chain of two, by FMPy and SciPy's Nelder-Mead.

usage: bench_fmpy.py FMU    prints ns per free component step and ns per synchronised step, the fastest of some blocks
"""
import shutil
import sys
import time

import fmpy
import fmpy.fmi2
import scipy.optimize

STEP = 0.01
EVALUATIONS = 20
COMPONENTS = 2  # and steps of the horizon


class Chain:
    def __init__(self, path):
        description = fmpy.read_model_description(path)
        reference = {variable.name: variable.valueReference for variable in description.modelVariables}
        self.folder = fmpy.extract(path)
        self.input, self.output = [reference["u"]], [reference["y"]]
        self.u, self.y = [0.0] * COMPONENTS, [0.0] * COMPONENTS
        self.instances = [self.instantiate(description) for _ in range(COMPONENTS)]

    def instantiate(self, description):
        instance = fmpy.fmi2.FMU2Slave(guid=description.guid, unzipDirectory=self.folder, instanceName="chain",
                                       modelIdentifier=description.coSimulation.modelIdentifier)
        instance.instantiate()
        instance.setupExperiment()
        instance.enterInitializationMode()
        instance.exitInitializationMode()
        return instance

    def step(self, number):
        for k, instance in enumerate(self.instances):
            instance.setReal(self.input, [self.u[k]])
            instance.doStep(number * STEP, STEP)
            self.y[k] = instance.getReal(self.output)[0]
        self.u[1:] = self.y[:-1]

    def save(self):
        return [instance.getFMUstate() for instance in self.instances], list(self.u)

    def restore(self, saved):
        for instance, state in zip(self.instances, saved[0]):
            instance.setFMUstate(state)
        self.u = list(saved[1])

    def release(self, saved):
        for instance, state in zip(self.instances, saved[0]):
            instance.freeFMUstate(state)

    def lock(self, number, measured):
        """Saves, searches the u at the first input that brings the last output to `measured`, commits one step."""
        saved = self.save()

        def objective(u):
            self.restore(saved)
            self.u[0] = u[0]
            for j in range(COMPONENTS):
                self.step(number + j)
            return (self.y[-1] - measured) ** 2

        found = scipy.optimize.minimize(objective, [1.0], method="Nelder-Mead",
                                        options={"maxfev": EVALUATIONS, "xatol": 0.0, "fatol": 0.0})
        self.restore(saved)
        self.u[0] = found.x[0]
        self.step(number)
        self.release(saved)


def fastest(work, steps, blocks=10):
    best = float("inf")
    for block in range(blocks):
        begun = time.thread_time_ns()
        for number in range(block * steps, (block + 1) * steps):
            work(number)
        best = min(best, (time.thread_time_ns() - begun) / steps)
    return best


def main():
    chain = Chain(sys.argv[1])
    try:
        print(fastest(chain.step, 2000) / COMPONENTS, fastest(lambda number: chain.lock(number, 1.0), 40))
    finally:
        shutil.rmtree(chain.folder)


main()
