//! Tests of the laboratory, in one program: linking is what costs, and each file of its own would
//! be linked with everything below it once more.

mod baker_convergence;
mod closed_forms;
mod convergence;
mod properties;
mod solvers;
mod studies;
