"""Compiled functions are saved by one process at a time, each loop under a name of its own."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numba
import pytest
from numba.core.caching import IndexDataCacheFile, NullCache

from rig import dampers
from rig.compile_notice import NOTICE, TEXT
from rig.dampers import compiled_cache, kernel, loop_curve, sprung_slopes, trajectory
from rig.hybrid import virtual_test
from rig.identification.models import kernels
from simulators import conditioner, frames
from simulators.plant import step


def test_numbas_own_save_is_guarded() -> None:
    assert IndexDataCacheFile.save.__wrapped__.__qualname__ == "IndexDataCacheFile.save"
    assert hasattr(IndexDataCacheFile("folder", "name", None), "_index_path")


def test_two_savers_take_turns(tmp_path: Path) -> None:
    inside, most = [0], [0]

    def save(_file: object) -> None:
        inside[0] += 1
        most[0] = max(most[0], inside[0])
        time.sleep(0.02)
        inside[0] -= 1

    locked = compiled_cache.saves_alone(save)
    file = SimpleNamespace(_index_path=str(tmp_path / "loop.nbi"))
    threads = [threading.Thread(target=locked, args=(file,)) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert most == [1]


def test_where_no_lock_can_be_had_it_is_saved_all_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    saved: list[object] = []
    locked = compiled_cache.saves_alone(saved.append)
    locked(nowhere := SimpleNamespace(_index_path=str(tmp_path / "gone" / "loop.nbi")))
    monkeypatch.setattr(compiled_cache, "import_module", lambda _: __import__("no_such_module"))
    locked(here := SimpleNamespace(_index_path=str(tmp_path / "loop.nbi")))
    assert saved == [nowhere, here]


def test_a_damaged_entry_is_none_and_is_written_again(tmp_path: Path) -> None:
    file = IndexDataCacheFile(str(tmp_path), "loop", "stamp")
    file.save("key", b"machine code")
    assert file.load("key") == b"machine code"
    entry, index = tmp_path / "loop.1.nbc", tmp_path / "loop.nbi"
    code = bytearray(entry.read_bytes())
    code[code.index(b"machine")] ^= 1  # still a pickle
    entry.write_bytes(code)
    assert file.load("key") is None
    for damaged in (index.read_bytes()[:40], b"", b"no pickle"):
        index.write_bytes(damaged)
        assert file.load("key") is None
        file.save("key", b"machine code")
        assert file.load("key") == b"machine code"


def test_a_full_disk_costs_the_entry_only(tmp_path: Path) -> None:
    def save(_file: object) -> None:
        raise OSError(28, "No space left on device")

    compiled_cache._not_kept.cache_clear()  # said once in a process
    with pytest.warns(RuntimeWarning, match="disk is full"):
        compiled_cache.saves_alone(save)(SimpleNamespace(_index_path=str(tmp_path / "loop.nbi")))


def test_slow_compiling_is_reported_once(monkeypatch: pytest.MonkeyPatch) -> None:
    reported: list[str] = []
    monkeypatch.setattr(NOTICE, "report", reported.append)
    monkeypatch.setattr(NOTICE, "after_s", 0.02)
    notice = compiled_cache.CompileNotice()
    for _ in range(3):
        notice.on_start(None)
        notice.on_start(None)
        time.sleep(0.015)
        notice.on_end(None)
        notice.on_end(None)
    assert reported == [TEXT]


def test_where_no_folder_can_be_written_it_is_compiled_and_not_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("numba.core.caching.CompileResultCacheImpl._locator_classes", [])
    compiled_cache._not_kept.cache_clear()  # said once in a process

    def doubled(x: float) -> float:
        return 2.0 * x

    with pytest.warns(RuntimeWarning, match="NUMBA_CACHE_DIR"):
        compiled = compiled_cache.njit(cache=True)(doubled)
    assert compiled(2.5) == 5.0


def test_no_two_models_share_an_index_or_a_symbol() -> None:
    models = [named for named in map(dampers.model, dampers.MODELS) if named.states]
    assert len(models) > 3
    for made in (kernel._pointwise_of, kernel._stepwise_of):
        names = {made(named).__qualname__ for named in models}  # type: ignore[arg-type]  # they have states
        assert len(names) == len(models)


def test_functions_of_one_name_that_do_other_things_have_other_names() -> None:
    def scaled(factor: float) -> Any:  # noqa: ANN401 - a compiled function
        @compiled_cache.njit()
        def times(x: float) -> float:
            return factor * x

        return times

    names = [scaled(factor).__qualname__ for factor in (2.0, 3.0, 2.0)]
    assert names[0] == names[2] != names[1]


@pytest.mark.parametrize("module", [kernel, loop_curve, kernels])
def test_what_a_compiled_function_calls_is_compiled_with_it(module: ModuleType) -> None:
    """Called from the cache it is not inlined: a study's last bits would depend on which process came first."""
    compiled = {name: value for name, value in vars(module).items() if hasattr(value, "py_func")}
    called = {name for value in compiled.values() for name in value.py_func.__code__.co_names}
    kept = {name for name, value in compiled.items() if not isinstance(value._cache, NullCache)}
    assert not called & kept


@pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled, so nothing is kept")
@pytest.mark.parametrize("named", ["bouc_wen", "bingham"])
def test_what_is_kept_closes_over_no_compiled_function_whose_number_is_another_in_each_process(named: str) -> None:
    model = dampers.model(named)
    made = [kernel._pointwise_of(model), kernel._stepwise_of(model), trajectory._trajectory_of(model),  # type: ignore[arg-type]  # integrable
            trajectory._inverse_of(model), step.plant_loop(), sprung_slopes.compiled_pass()]  # type: ignore[arg-type]  # fmt: skip
    modules = (frames, conditioner, kernels, loop_curve, virtual_test)
    known = [value for module in modules for value in vars(module).values() if hasattr(value, "py_func")]
    kept = [value for value in (*made, *known) if not isinstance(value._cache, NullCache)]
    names = {value.py_func.__name__ for value in kept}
    assert {"encode_frames", "encode_samples", "pointwise", "stepwise", "run"} <= names
    for value in kept:
        closed = [cell.cell_contents for cell in value.py_func.__closure__ or ()]
        assert not [over for over in closed if hasattr(over, "py_func")], value.__qualname__


def test_a_changed_compensator_is_another_entry_of_the_cache(tmp_path: Path) -> None:
    """What `_run` calls lies in other files; numba compares the time of its own file alone."""
    room = Path(virtual_test.__file__).parent
    changed = tmp_path / "hybrid"
    shutil.copytree(room, changed, ignore=shutil.ignore_patterns("__pycache__"))
    assert kernel.fingerprint(changed) == kernel.fingerprint(room)
    with (changed / "compensators.py").open("a", encoding="utf-8") as file:
        file.write("# another gain\n")
    marks = kernel.fingerprint(room), kernel.fingerprint.__wrapped__(changed)  # what it said before is kept
    assert marks[0] != marks[1]
    for made, loop in ((virtual_test._run, virtual_test._whole_loop), (virtual_test._once, virtual_test._one_step)):
        (key,) = (cell.cell_contents for cell in made.py_func.__closure__)
        assert str(marks[0]) in key
        names = {kernel.cached(loop(str(mark))).__qualname__ for mark in marks}
        assert len(names) == 2


def test_a_part_of_a_loop_is_called_from_python_too() -> None:
    @compiled_cache.njit()
    def doubled(x: float) -> float:
        return 2.0 * x

    @compiled_cache.njit()
    def summed(n: int) -> float:
        total = 0.0
        for i in range(n):
            total += doubled(float(i))
        return total

    assert summed(4) == 12.0
    assert (doubled(3.0), doubled(1.0)) == (6.0, 2.0)


SUMS = """
import hashlib, numpy
from rig.identification.models.kernels import tanh_objective
draws = numpy.random.default_rng(1).standard_normal
sums = tanh_objective(draws((300, 12)), *(draws(1042) for _ in range(6)))
print(hashlib.sha256(sums.tobytes()).hexdigest())
"""


def test_what_is_compiled_and_what_comes_from_the_cache_gives_the_same_bits(tmp_path: Path) -> None:
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path), "NUMBA_DISABLE_JIT": "0"}
    reported = [subprocess.check_output([sys.executable, "-c", SUMS], env=environment) for _ in range(2)]
    assert reported[0] == reported[1]
    assert list(tmp_path.rglob("*.nbc")), "the second one had nothing to take"
