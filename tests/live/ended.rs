//! Pages of a run that ends.

use super::served::Served;
use trinocular_tests::binary::signal;

#[test]
fn page_learns_that_the_run_has_ended() {
    let mut served = Served::start("60");
    served.page.state(|state| state["turns"].as_u64() > Some(2));
    signal(&served.program, "INT");
    served.page.state(|state| state["ended"] == true);
}
