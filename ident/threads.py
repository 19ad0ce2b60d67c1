"""One thread for the linear algebra of one call."""

from threadpoolctl import threadpool_limits

# Matrix products here are tall and narrow and take a millisecond; threads that share them wait for
# each other, up to a second where another process has the cores.
one_thread = threadpool_limits.wrap(limits=1, user_api="blas")
