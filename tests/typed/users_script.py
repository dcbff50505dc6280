"""What a user writes: run by nobody, but read by type checkers, which must find nothing wrong with it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt
from numpy.typing import NDArray

import pipeline as mcl


class Heaviest:
    """A sink of one's own: the weight of the estimate at every scan."""

    def __init__(self) -> None:
        self.weights: list[float] = []

    def log(self, step: mcl.Step) -> None:
        self.weights.append(step.estimate.weight)


def read(path: str) -> mcl.Log:
    names = mcl.Names(scan_topic="/front/scan", laser_pose=(0.2, 0.0, 0.0))
    log: mcl.Log = mcl.read_log(path, mcl.load_map(Path("map.yaml")), names)
    remarks: tuple[str, ...] = log.remarks
    laser: mcl.Laser = log.laser
    print(log, remarks, laser.angles.shape, log.grid and log.grid.known_area)
    return log


def step_by_step(log: mcl.Log) -> mcl.RunResult:
    config = mcl.Config(sigma_hit=0.2, sensor_model="likelihood_field")
    run = mcl.Localizer(log, config, seed=3, threads=1)
    for step in run:
        particles: NDArray[np.float32] = step.particles
        weights: NDArray[np.float64] = step.weights
        estimate: mcl.Estimate = step.estimate
        beams: mcl.Beams = step.beams
        events: tuple[mcl.Event, ...] = step.events
        verdict: mcl.Verdict = step.verdict
        print(particles.shape, weights.sum(), estimate.pose, beams.worth, events, verdict.kind, verdict.probability)
        if verdict.kind == "found" and log.grid is not None:
            mcl.draw_belief(step, log.grid)
            plt.savefig("belief.png")
            break
    return run.finish()


def whole(log: mcl.Log) -> mcl.RunResult:
    heaviest = Heaviest()
    sinks: list[mcl.Sink] = [heaviest]
    result = mcl.localize(log, mcl.load_config("likelihood_field.yaml"), seed=0, sinks=sinks)
    trajectory: mcl.Trajectory = result.trajectory
    mcl.write_tum("out.tum", trajectory)
    distance, turn = mcl.run_errors(result, mcl.read_tum("truth.tum"))
    score: mcl.Score = mcl.score_run(result)
    print(max(heaviest.weights), np.median(distance), np.median(turn), score.success, result.converged_at)
    mcl.draw_run(result).set_title("mine")
    return result


def judged(log: mcl.Log) -> None:
    evaluation: mcl.Evaluation = mcl.evaluate_logs([log], runs=5)
    one: mcl.LogEvaluation = evaluation.logs[0]
    print(one.success_rate, one.wall)
    configs = {"beam": mcl.Config(), "field": mcl.Config(sensor_model="likelihood_field")}
    comparison: mcl.Comparison = mcl.compare_configs(log, configs, runs=5, seed=10)
    print([(each.variant, each.p_success, each.error.p) for each in comparison.paired])
    mcl.plot_evaluation(comparison, "comparison.png")


def recorded(log: mcl.Log) -> None:
    replay: mcl.Replay = mcl.record_run(log, output="run", seed=1)
    run: mcl.Run = mcl.read_run(replay.folder.path)
    poses: NDArray[np.float64] = run.told.poses
    mcl.export_run(run, "run.png", mcl.Wishes(at=[12.5]))
    both: mcl.RunComparison = mcl.compare_runs(run, run)
    amcl = mcl.compare_runs(run, mcl.Track("amcl.tum", mcl.read_tum("amcl.tum")))
    print(poses[-1], both.common, both.config, amcl.apart)


def main() -> int:
    try:
        log = read("log.bag")
        scan: mcl.Scan = next(log.scans())
        grid: mcl.OccupancyGrid | None = log.grid
        if grid is not None:
            mcl.draw_map(grid, plt.subplots()[1])
        print(scan.ranges.dtype, grid, step_by_step(log), whole(mcl.sample_log()))
        judged(log)
        recorded(log)
        print(mcl.dump_config(mcl.Config()))
    except mcl.MclError as error:
        print(error)
        return 1
    return 0
