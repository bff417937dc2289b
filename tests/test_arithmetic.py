"""A network gives the same bytes on processors of other kinds, which an emulator plays here where there is one."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from pdrbench.arithmetic import same_everywhere
from pdrbench.evaluation import evaluate
from pdrbench.result import COMPLETE

EMULATOR = shutil.which("qemu-x86_64")
PROCESSORS = ("Haswell", "EPYC")  # of two makers; neither has the wider instructions of newer ones
NETWORK = """
import sys
import numpy as np
import torch

torch.manual_seed(0)
torch.set_num_threads(1)
rows = torch.from_numpy(np.random.default_rng(0).standard_normal((1, 6, 200)).astype(np.float32))
convolution, memory = torch.nn.Conv1d(6, 64, 7, stride=2), torch.nn.GRU(64, 96, batch_first=True)
with torch.inference_mode():
    answer = memory(torch.nn.functional.gelu(convolution(rows)).transpose(1, 2))[0]
sys.stdout.write(answer.numpy().tobytes().hex())
"""
ALIKE = """
import os
import numpy as np
from pdrbench import Estimate

class Alike:
    def reset(self, briefing, rng):
        pass

    def step(self, observation):
        is_alike = all(os.environ.get(name) == value for name, value in {wanted}.items())
        return Estimate(np.array([float(is_alike), 0.0]), 0)
"""


def answer(*before: str) -> str:
    environment = {**os.environ, **same_everywhere()}
    command = [*before, sys.executable, "-c", NETWORK]
    return subprocess.run(command, env=environment, check=True, capture_output=True, text=True, timeout=250).stdout


@pytest.mark.timeout(600)
@pytest.mark.long(seconds=100)
@pytest.mark.skipif(EMULATOR is None, reason="no qemu-x86_64 here, which plays other processors")
@pytest.mark.skipif(not same_everywhere(), reason="a processor without AVX2")
def test_networks_answer_alike_on_other_processors() -> None:
    pytest.importorskip("torch")
    here = answer()
    assert len(here) > 1000
    for processor in PROCESSORS:
        assert answer(str(EMULATOR), "-cpu", processor) == here, processor


@pytest.mark.slow
def test_a_localizer_in_a_process_of_its_own_computes_alike(tmp_path: Path) -> None:
    file = tmp_path / "alike.py"
    file.write_text(ALIKE.format(wanted=dict(same_everywhere())))
    (result,) = evaluate(f"{file}:Alike", "OfficeStride-v0", walks=1, seeds=1, isolation="process").results
    assert result.status == COMPLETE
    assert set(result.estimates.columns[0]) == {1.0}


@pytest.mark.skipif(not same_everywhere(), reason="a processor without AVX2")
def test_who_uses_the_learned_models_computes_alike() -> None:
    code = "import os, pdrbench_baselines.learned as _; print([os.environ[name] for name in {names}])"
    wanted = {**same_everywhere(), "MKL_CBWR": "AVX2"}  # what the user has set stays
    found = subprocess.run(
        [sys.executable, "-c", code.format(names=[*wanted])],
        env={**os.environ, "MKL_CBWR": "AVX2"},
        check=True,
        capture_output=True,
        text=True,
    ).stdout
    assert found.strip() == str([*wanted.values()])
