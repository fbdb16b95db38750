//! Tells the linker where the memory map is. For a Cortex-M, with cortex-m-rt's script, it also
//! compiles the plain C observers with arm-none-eabi-gcc for the processor in `HGO_CPU` (cortex-m4
//! or cortex-m7).

use std::env::var;
use std::process::Command;

fn main() {
    let here = var("CARGO_MANIFEST_DIR").unwrap_or_default();
    println!("cargo::rustc-link-search={here}");
    println!("cargo::rustc-link-arg=--nmagic");
    match var("CARGO_CFG_TARGET_ARCH").as_deref() {
        Ok("arm") => cortex_m(),
        Ok("aarch64") => virt(0x4020_0000), // QEMU lays its device tree at the start of memory
        Ok("riscv32") => virt(0x8000_0000),
        other => panic!("no board for the architecture {other:?}"),
    }
}

/// QEMU's machine `virt`: memory alone, from `start`.
fn virt(start: u32) {
    println!("cargo::rustc-link-arg=-Tvirt.ld");
    println!("cargo::rustc-link-arg=--defsym=memory_start={start:#x}");
    println!("cargo::rerun-if-changed=virt.ld");
}

fn cortex_m() {
    println!("cargo::rustc-link-arg=-Tlink.x");
    println!("cargo::rerun-if-changed=memory.x");
    println!("cargo::rerun-if-env-changed=HGO_CPU");

    let cpu = var("HGO_CPU").unwrap_or_else(|_| "cortex-m4".into());
    let fpu = if cpu == "cortex-m7" { "fpv5-d16" } else { "fpv4-sp-d16" };
    let machine = [
        format!("-mcpu={cpu}"),
        "-mthumb".into(),
        "-mfloat-abi=hard".into(),
        format!("-mfpu={fpu}"),
    ];
    let mut build = cc::Build::new();
    build.compiler("arm-none-eabi-gcc").archiver("arm-none-eabi-ar").no_default_flags(true);
    for flag in &machine {
        build.flag(flag);
    }
    // the same arithmetic as written: no fused multiply-add
    for flag in ["-O2", "-std=c11", "-ffp-contract=off", "-ffunction-sections", "-Wall", "-Wextra"]
    {
        build.flag(flag);
    }
    build.file("../c/plain.c").compile("plain");
    println!("cargo::rerun-if-changed=../c/plain.c");
    println!("cargo::rerun-if-changed=../c/plain.h");

    // powf of the C library that comes with that compiler
    let library = Command::new("arm-none-eabi-gcc")
        .args(&machine)
        .arg("-print-file-name=libm.a")
        .output()
        .expect("arm-none-eabi-gcc runs");
    let path = String::from_utf8_lossy(&library.stdout);
    let folder = std::path::Path::new(path.trim()).parent().expect("a path of libm.a");
    println!("cargo::rustc-link-search={}", folder.display());
    for library in ["m", "c"] {
        println!("cargo::rustc-link-lib=static:-bundle={library}");
    }
}
