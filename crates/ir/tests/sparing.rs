//! Lines of LLVM IR in an order that needs few registers.

use hgo_ir::sparing::ordered;

fn lines(text: &str) -> Vec<String> {
    text.lines().map(str::to_owned).collect()
}

#[test]
fn sums_are_taken_as_soon_as_their_products_are_there() {
    let text = "  %z = phi double [ 0.0, %entry ], [ %sum, %loop ]\n\
                \x20 %a = fmul double %x, %x\n\
                \x20 %b = fmul double %y, %y\n\
                \x20 %c = fadd double %a, %z\n\
                \x20 store double %c, ptr %p\n\
                \x20 %sum = fadd double %b, %b";
    let given = lines(text);
    let found = ordered(given.clone());
    let mut both = (given.clone(), found.clone());
    both.0.sort();
    both.1.sort();
    assert_eq!(both.0, both.1, "the same lines");
    // %a ends with the sum, which the store ends: neither waits for the other product
    assert_eq!(found[..4], [0, 1, 3, 4].map(|at| given[at].clone()));
}

#[test]
fn no_line_comes_before_what_it_takes() {
    // a chain written in its order must stay in it, whatever it frees
    let chain: Vec<String> =
        (1..50).map(|i| format!("  %v{i} = fadd double %v{}, %v{}", i - 1, i / 2)).collect();
    assert_eq!(ordered(chain.clone()), chain);
    assert!(ordered(Vec::new()).is_empty());
}
