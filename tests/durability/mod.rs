//! Durability: what was acknowledged stays, whatever happens to the process or to the machine.

#![expect(
    clippy::unwrap_used,
    clippy::panic,
    clippy::print_stdout,
    reason = "a test that cannot go on fails, and says what it has counted"
)]

mod approvers;
mod campaign;
mod clock;
mod disk;
mod full_disk;
mod hanging;
mod injected;
mod kill;
mod lifecycle;
mod memory;
mod place;
mod power;
mod records;
mod said;
mod seeds;
mod short_writes;
mod small_disk;
mod stuck;
mod trace;
mod witness;
