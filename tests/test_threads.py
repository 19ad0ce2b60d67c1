"""What the library computes with is one thread, whatever the process was started with."""

from threadpoolctl import threadpool_info

from ident.threads import one_thread


def test_a_call_uses_one_thread_and_leaves_the_others_as_they_were():
    def blas():
        return [one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"]

    before = blas()
    assert set(one_thread(blas)()) == {1}
    assert blas() == before
