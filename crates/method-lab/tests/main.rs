//! Tests of the laboratory as one program, because linking each file separately takes most of the
//! time.

mod baker_convergence;
mod closed_forms;
mod convergence;
mod properties;
mod solvers;
mod studies;
