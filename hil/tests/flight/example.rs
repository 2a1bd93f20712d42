//! The example flight computer, `examples/flight_controller.rs`, flies the scenario written for it: newtons,
//! radians, thrusters that only switch, and a position beacon at 5 Hz.

#![allow(clippy::disallowed_methods)] // the test runs programs and reads what they leave

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Ends with the test, whatever happens in it.
struct Program(Child);

impl Drop for Program {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Cargo builds the examples of a package together with its tests, beside the program.
fn example() -> PathBuf {
    let path = Path::new(env!("CARGO_BIN_EXE_hopbench")).with_file_name("examples").join("flight_controller");
    assert!(path.is_file(), "{}: build it with cargo build --example flight_controller", path.display());
    path
}

/// The address that the bench bound, once its ready file is there.
fn address(ready: &Path) -> String {
    let deadline = Instant::now() + Duration::from_secs(20);
    loop {
        if let Ok(text) = std::fs::read_to_string(ready) {
            let addresses: serde_json::Value = serde_json::from_str(&text).unwrap();
            return addresses["fc"].as_str().unwrap().trim_start_matches("udp-listen:").to_owned();
        }
        assert!(Instant::now() < deadline, "no {}", ready.display());
        std::thread::sleep(Duration::from_millis(10));
    }
}

#[test]
fn the_example_computer_hovers_and_lands() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let folder = std::env::temp_dir().join(format!("hopbench-example-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let ready = folder.join("ready.json");
    let bench = Command::new(env!("CARGO_BIN_EXE_hopbench"))
        .current_dir(root)
        .args(["hil", "scenarios/own_computer.toml", "--json", "--lockstep", "--fast"])
        // A busy machine is no silent computer.
        .args(["--lockstep-timeout-ms", "1000", "--set", "fc_timeout_ms=5000"])
        .args(["--fc", "udp-listen:127.0.0.1:0", "--ready-file"])
        .arg(&ready)
        .arg("--out")
        .arg(folder.join("run"))
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let mut bench = Program(bench);
    let computer = Command::new(example()).arg(address(&ready)).stderr(Stdio::null()).spawn().unwrap();
    let mut computer = Program(computer);

    let mut text = String::new();
    std::io::Read::read_to_string(&mut bench.0.stdout.take().unwrap(), &mut text).unwrap();
    assert_eq!(bench.0.wait().unwrap().code(), Some(0), "{text}");
    assert!(computer.0.wait().unwrap().success());
    let result: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(result["outcome"], "landed");
    assert_eq!(result["expect"]["passed"], true);
    assert_eq!(result["flown_by"][0]["source"], "fc");
    assert_eq!(result["flown_by"].as_array().unwrap().len(), 1);
    let _ = std::fs::remove_dir_all(&folder);
}
