"""Work that is shared out among threads."""

import os

import pytest

from granphon.base import threads
from granphon.runs.workers import Workers


def test_work_is_shared_out_in_order_and_its_errors_are_raised(monkeypatch):
    monkeypatch.setattr(threads, "count_processors", lambda: 3)
    assert threads.share_out(lambda n: n * n, range(20)) == [n * n for n in range(20)]
    assert threads.share_out(abs, []) == []
    with pytest.raises(ZeroDivisionError):
        threads.share_out(lambda n: 1 // (n - 3), range(8))


def test_a_worker_process_has_one_processor():
    """Others work beside it."""
    with Workers(2) as executor:
        assert executor.submit(threads.count_processors).result() == 1
    assert 1 <= threads.count_processors() <= (os.cpu_count() or 1)


def test_products_are_held_to_one_thread():
    from threadpoolctl import threadpool_info

    before = [library["num_threads"] for library in threadpool_info()]
    with threads.single_products():
        assert {library["num_threads"] for library in threadpool_info()} == {1}
    assert [library["num_threads"] for library in threadpool_info()] == before
