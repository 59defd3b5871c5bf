//! The committed table of what the controller's work costs on the chip, `firmware/budget.toml`.

use std::path::Path;

use adit_emulator::costs::{ROWS, measure};

#[test]
fn every_piece_of_work_keeps_its_budget() {
    let top = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let text = std::fs::read_to_string(top.join("firmware/budget.toml")).expect("the budget");
    let budget: toml::Table = text.parse().expect("a table");
    let costs = measure(&top.join("target/image/instructions.elf")).expect("costs");
    println!("{:34} {:>9} {:>9} {:>9}", "instructions", "longest", "mean", "budget");
    let mut over = Vec::new();
    for (row, cost) in ROWS.iter().zip(costs) {
        let most = budget["instructions"][row].as_integer().expect("a number");
        println!("{row:34} {:>9} {:>9} {most:>9}", cost.longest, cost.mean);
        assert!(cost.mean > 0, "{row} was not measured");
        if cost.longest as i64 > most {
            over.push(row);
        }
        assert!(!row.starts_with("step") || most <= 50_000, "a step in flight has 50,000 instructions, not {most}");
    }
    assert!(over.is_empty(), "over budget: {over:?}");
}
