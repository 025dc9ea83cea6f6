"""Sines and cosines of laws and angles: as in long arithmetic, and the same bits everywhere."""

import hashlib
import os
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mpmath import MPContext

from newmark_cli.mechanisms import sines
from newmark_cli.mechanisms.elements import sine_cosine

mp = MPContext()
mp.dps = 60


@given(st.floats(-1e5, 1e5))
def test_they_are_off_by_less_than_a_unit_in_the_last_place(x):
    """Also next to multiples of π/2, where the reduction cancels all but the last bits."""
    for near in (x, round(x) * np.pi / 2, np.nextafter(round(x) * np.pi / 2, np.inf)):
        found = sine_cosine(near, np.float64)
        for value, exact in zip(found, (mp.sin(near), mp.cos(near)), strict=True):
            assert abs(float((value - exact) / np.spacing(abs(float(exact))))) < 1


def test_single_precision_stays_single():
    """The type of the results is the one that is asked for."""
    sine, cosine = sine_cosine(np.float32(0.5), np.float32)
    assert (sine, cosine) == (np.float32(np.sin(0.5)), np.float32(np.cos(0.5)))
    assert np.isnan(sine_cosine(np.inf, np.float64)[0])


def test_interpreted_and_compiled_have_the_same_bits():
    """Families of chains are made without the compiler; complex steps give derivatives."""
    for x in np.linspace(-40, 40, 999):
        assert sines.sine_cosine(x, np.float64) == sine_cosine(x, np.float64)
    sine, cosine = sine_cosine(2.5 + 1e-30j, np.complex128)
    assert (sine.imag, cosine.imag) == pytest.approx((1e-30 * np.cos(2.5), -1e-30 * np.sin(2.5)))


def hashed():
    """Of sines and cosines of 2·10⁴ numbers."""
    numbers = np.random.default_rng(1).uniform(-50, 50, 20_000)
    values = np.array([sine_cosine(x, np.float64) for x in numbers])
    return hashlib.sha256(values.tobytes()).hexdigest()


def test_bits_do_not_depend_on_the_processor():
    """Of 2·10⁴ arguments; glibc's differ in some fourteen without fused multiply-adds."""
    other = {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA", "NUMBA_CPU_NAME": "generic"}
    other |= {"PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(
        [sys.executable, "-c", "import test_sines; print(test_sines.hashed())"],
        env=os.environ | other, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stdout.strip() == hashed()
