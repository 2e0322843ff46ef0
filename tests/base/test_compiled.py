"""Compiled loops and interruptions."""

import signal

import pytest

from granphon.base.compiled import compiled


def test_ctrl_c_while_numba_compiles_comes_when_it_is_done(tmp_path, monkeypatch):
    numba = pytest.importorskip("numba")
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))

    def halve(x):
        return 0.5 * x

    loop, parts = compiled(halve), []
    compile_part = loop._compiler.compile

    def interrupted(*arguments):
        signal.raise_signal(signal.SIGINT)
        parts.append(compile_part(*arguments))
        return parts[-1]

    monkeypatch.setattr(loop._compiler, "compile", interrupted)
    with pytest.raises(KeyboardInterrupt):
        loop(3.0)
    assert len(parts) == len(loop.signatures) == 1
    assert loop(3.0) == 1.5
