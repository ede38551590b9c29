import os
import subprocess
import sys

import pytest
import torch

from learned.motion_discriminator import TABLE_I
from learned.networks import architecture
from learned.threads import at_most, worth_having
from learned.torch_graph import network

DEFAULT = "import os, learned; print(os.environ['OMP_WAIT_POLICY'])"


@pytest.fixture
def two_threads():
    """As on a machine of two cores."""
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    yield
    torch.set_num_threads(before)


@pytest.mark.usefixtures("two_threads")
@pytest.mark.parametrize(("width", "batch", "threads"), [(64, 256, 1), (None, 1024, 2)])
def test_only_large_steps_are_shared_between_threads(width, batch, threads):
    shape = architecture("hrdl-md", 6, sum(map(len, TABLE_I)), width=width)
    assert worth_having(network(shape, 0, 0), batch) == threads


@pytest.mark.usefixtures("two_threads")
def test_threads_are_as_many_as_before_afterwards():
    with at_most(1):
        assert torch.get_num_threads() == 1
    assert torch.get_num_threads() == 2
    with at_most(8):
        assert torch.get_num_threads() == 2


@pytest.mark.parametrize(("given", "used"), [({}, "PASSIVE"), ({"OMP_WAIT_POLICY": "ACTIVE"}, "ACTIVE")])
def test_waiting_threads_let_others_go_on_unless_the_user_says_otherwise(given, used):
    environment = {key: value for key, value in os.environ.items() if key != "OMP_WAIT_POLICY"} | given
    answer = subprocess.run(
        [sys.executable, "-c", DEFAULT], env=environment, capture_output=True, text=True, check=True
    )
    assert answer.stdout.strip() == used
