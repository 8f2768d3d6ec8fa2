//! Prints the OpenAPI document of the HTTP API, from which the dashboard's types are made:
//! `cargo run --release -p fleetcal --example openapi > web/openapi.json`.

use std::io::Write;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let document = fleetcal_api::openapi().to_pretty_json()?;
    writeln!(std::io::stdout(), "{document}")?;
    Ok(())
}
