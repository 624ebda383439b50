"""Where a population is evaluated: here, or on any `concurrent.futures.Executor`, in few large chunks.

An objective carries its recordings, so it travels to a worker process once, not with each task: a task names the
objective by a token, and a worker that does not know the token answers so and is sent the pickled objective along
with the same task. Forked workers and threads find it in this module already. Shipping a 41,667-sample recording with
every task costs 28 x the evaluation.
"""

from __future__ import annotations

import os
import pickle
import uuid
from collections import OrderedDict
from concurrent.futures import Executor, Future
from typing import Protocol

import numpy as np

from rig.optimisers.arrays import FloatArray


class Objective(Protocol):
    """What is minimised: a function of `n_parameters` numbers, evaluated a population at a time."""

    @property
    def n_parameters(self) -> int:
        """Number of parameters p."""

    def batch(self, population: FloatArray, /) -> FloatArray:
        """Values of a population.

        Args:
            population: Shape (N, p), one candidate a row, in the parameters' own units.

        Returns:
            Shape (N,): the objective's value of each row; NaN counts as worst.
        """


KEPT_OBJECTIVES = 8
"""Objectives a worker remembers; the oldest goes first."""

_known: OrderedDict[str, Objective] = OrderedDict()


def _remember(token: str, objective: Objective) -> None:
    _known[token] = objective
    while len(_known) > KEPT_OBJECTIVES:
        _known.popitem(last=False)


def evaluate_chunk(token: str, points: FloatArray, payload: bytes | None = None) -> FloatArray | None:
    """Run in the worker: values of one chunk.

    Args:
        token: Name of the objective.
        points: Shape (n, p).
        payload: The pickled objective, sent only to a worker that said it does not know it.

    Returns:
        Shape (n,), or None when this worker does not know the objective.
    """
    objective = _known.get(token)
    if objective is None:
        if payload is None:
            return None
        objective = pickle.loads(payload)
        _remember(token, objective)
    return np.asarray(objective.batch(points), dtype=np.float64)


class Evaluation:
    """Evaluates populations of one objective, here or on an executor.

    Attributes:
        shipped: How many times the objective was sent to a worker.
    """

    def __init__(self, executor: Executor | None = None, chunks: int | None = None) -> None:
        self.executor = executor
        self.chunks = (os.cpu_count() or 1) if chunks is None else chunks
        self.shipped = 0
        self._token = ""
        self._payload: bytes | None = None

    def values(self, objective: Objective, points: FloatArray) -> FloatArray:
        """Values of a population.

        Args:
            objective: What is minimised; the same one on every call.
            points: Shape (N, p).

        Returns:
            Shape (N,).
        """
        if self.executor is None or len(points) < 2:
            return objective.batch(points) if len(points) else np.empty(0)
        if not self._token:
            self._token = uuid.uuid4().hex
            _remember(self._token, objective)
        parts = np.array_split(points, min(self.chunks, len(points)))
        futures = [self.executor.submit(evaluate_chunk, self._token, part) for part in parts]
        return np.concatenate(
            [self._answer(objective, part, future) for part, future in zip(parts, futures, strict=True)]
        )

    def _answer(self, objective: Objective, part: FloatArray, future: Future[FloatArray | None]) -> FloatArray:
        answer = future.result()
        if answer is not None:
            return answer
        if self.executor is None:
            raise RuntimeError("an evaluation without an executor has no futures")
        if self._payload is None:
            self._payload = pickle.dumps(objective)
        self.shipped += 1
        reported = self.executor.submit(evaluate_chunk, self._token, part, self._payload).result()
        if reported is None:
            raise RuntimeError(f"a worker does not have the objective {self._token}, although it was sent")
        return reported
