"""The optimal-control problem of the predictive controller and its two solvers."""
