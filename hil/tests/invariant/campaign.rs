//! What a campaign promises of itself: the same bytes in whatever order, share or number of attempts it is
//! flown, every flight again on its own, and the name of what is wrong.

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::OnceLock;
use std::sync::atomic::AtomicBool;

use hopbench::simulation::{Flight, data_sheet, fly_out};
use hopbench_hil::evidence::campaign::Campaign;
use hopbench_hil::load;

/// A short hop: two metres up and down.
const SHORT: [&str; 4] = [
    "mission.alignment_s=1.0",
    "mission.hover_height_m=2.0",
    "mission.hover_time_s=0.5",
    "wind.from_deg=10.0",
];

const DISPERSIONS: &str = r#"
[[dispersion]]
key = "wind.mean_speed_m_s"
distribution = "uniform"
low = 0.0
high = 4.0
mode = "value"
source = "a test"

[[dispersion]]
name = "mass"
key = "vehicle.component.*.mass_kg"
distribution = "normal"
three_sigma = 0.03
mode = "factor"
source = "a test"

[[dispersion]]
name = "centre of mass"
key = "vehicle.component.0.position_m"
distribution = "circle"
radius = 0.02
source = "a test"
"#;

fn scenario() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios/hover_5m.toml")
}

/// An empty folder of this name.
fn folder(name: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("campaign-{name}"));
    let _ = std::fs::remove_dir_all(&path);
    std::fs::create_dir_all(&path).unwrap();
    path
}

/// A campaign file in a folder; line 1 names the scenario.
fn campaign(folder: &Path, rest: &str) -> PathBuf {
    let path = folder.join("short.toml");
    std::fs::write(&path, format!("scenario = '{}'\n{rest}", scenario().display())).unwrap();
    path
}

fn hopbench(arguments: &[&str]) -> Output {
    command(arguments).output().unwrap()
}

fn command(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_hopbench"));
    command.args(arguments);
    for pair in SHORT {
        command.args(["--set", pair]);
    }
    // A campaign without --out makes its folder where it is called.
    command.current_dir(env!("CARGO_TARGET_TMPDIR"));
    command
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn flights(folder: &Path) -> String {
    std::fs::read_to_string(folder.join("flights.csv")).unwrap()
}

const RUNS: usize = 5;

/// Campaign file and folder of the whole of it, flown one at a time.
fn whole() -> &'static (PathBuf, PathBuf) {
    static WHOLE: OnceLock<(PathBuf, PathBuf)> = OnceLock::new();
    WHOLE.get_or_init(|| {
        let folder = folder("whole");
        let file = campaign(&folder, &format!("runs = {RUNS}\nseed = 40\n{DISPERSIONS}"));
        let out = folder.join("out");
        let ended =
            hopbench(&["campaign", file.to_str().unwrap(), "--jobs", "1", "--out", out.to_str().unwrap()]);
        assert_eq!(ended.status.code(), Some(0), "{}{}", text(&ended.stdout), text(&ended.stderr));
        assert_eq!(flights(&out).lines().count(), 1 + RUNS);
        (file, out)
    })
}

#[test]
fn shards_flown_two_at_a_time_merge_to_the_bytes_of_the_whole() {
    let (file, whole) = whole();
    let (file, parts) = (file.to_str().unwrap(), folder("shards"));
    let out = |name: &str| parts.join(name).to_str().unwrap().to_owned();
    for (shard, name) in [("2/2", "b"), ("1/2", "a")] {
        let ended = hopbench(&["campaign", file, "--shard", shard, "--jobs", "2", "--out", &out(name)]);
        assert_eq!(ended.status.code(), Some(0), "{}", text(&ended.stderr));
    }
    let lacking = hopbench(&["campaign", file, "--merge", &out("a"), "--out", &out("lacking")]);
    assert_eq!(lacking.status.code(), Some(2));
    assert!(text(&lacking.stderr).contains("lack 2 of 5 flights, the first of seed 41"), "{lacking:?}");
    let merged = hopbench(&["campaign", file, "--merge", &out("b"), &out("a"), "--out", &out("merged")]);
    assert_eq!(merged.status.code(), Some(0), "{}", text(&merged.stderr));
    assert_eq!(flights(&parts.join("merged")), flights(whole));
    let summary = |folder: &Path| std::fs::read(folder.join("summary.json")).unwrap();
    assert_eq!(summary(&parts.join("merged")), summary(whole));
}

#[test]
fn an_interrupted_campaign_goes_on_where_it_stopped() {
    let (file, whole) = whole();
    let out = folder("resumed");
    std::fs::copy(whole.join("campaign.json"), out.join("campaign.json")).unwrap();
    let table = flights(whole);
    // Two flights and a half.
    let third = table.match_indices('\n').nth(2).unwrap().0;
    std::fs::write(out.join("flights.csv"), &table[..third + 30]).unwrap();
    let (file, out_text) = (file.to_str().unwrap(), out.to_str().unwrap());
    let ended = hopbench(&["campaign", file, "--jobs", "1", "--out", out_text]);
    assert_eq!(ended.status.code(), Some(0), "{}", text(&ended.stderr));
    assert!(text(&ended.stderr).contains("2 of 5 flights are there already"), "{}", text(&ended.stderr));
    assert_eq!(flights(&out), table);
    // Another campaign touches none of it.
    let other = hopbench(&["campaign", file, "--seed", "41", "--out", out_text]);
    assert_eq!(other.status.code(), Some(2));
    assert!(text(&other.stderr).contains("holds flights of another campaign"), "{}", text(&other.stderr));
    assert_eq!(flights(&out), table);
}

/// Flights in the air are flown out and kept, and there are no others; the same folder goes on from there.
#[test]
fn ctrl_c_keeps_what_was_flown() {
    let (file, whole) = whole();
    let out = folder("stopped");
    let arguments =
        ["campaign", file.to_str().unwrap(), "--jobs", "2", "--out", out.to_str().unwrap(), "--runs"];
    let many = [&arguments[..], &["400"]].concat();
    let mut running = command(&many).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let lines = || std::fs::read_to_string(out.join("flights.csv")).map_or(0, |table| table.lines().count());
    while lines() < 3 {
        assert_eq!(running.try_wait().unwrap(), None, "it ended by itself");
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    let signalled = Command::new("kill").args(["-INT", &running.id().to_string()]).status().unwrap();
    assert!(signalled.success());
    let ended = running.wait_with_output().unwrap();
    assert_eq!(ended.status.code(), Some(130), "{}", text(&ended.stderr));
    let kept = lines() - 1;
    let said = format!("interrupted: {kept} of 400 flights kept in {}", out.display());
    assert!(text(&ended.stderr).contains(&said), "{}", text(&ended.stderr));
    assert!(text(&ended.stderr).contains("the same --out goes on"), "{}", text(&ended.stderr));
    assert_eq!(ended.stdout, b"", "no verdict");
    let runs = kept.max(RUNS).to_string();
    let gone_on = hopbench(&[&arguments[..], &[runs.as_str()]].concat());
    assert_eq!(gone_on.status.code(), Some(0), "{}", text(&gone_on.stderr));
    let table = flights(&out);
    assert!(table.starts_with(&flights(whole)), "{table}");
}

/// A bare rate is luck: one flight of one bounds the rate at 0.05, Clopper and Pearson's 0.05^(1/1), and 59
/// of 59 would be needed for 95 %.
#[test]
fn a_rate_met_is_not_called_proven() {
    let (file, _) = whole();
    let out = folder("verdict");
    let arguments =
        ["campaign", file.to_str().unwrap(), "--runs", "1", "--json", "--out", out.to_str().unwrap()];
    let json = hopbench(&arguments);
    let summary: serde_json::Value = serde_json::from_slice(&json.stdout).unwrap();
    assert_eq!((&summary["passed"], &summary["proven"]), (&true.into(), &false.into()));
    assert_eq!(json.status.code(), Some(0));
    let told = hopbench(&[&arguments[..4], &arguments[5..]].concat());
    let expected = "PASSED: wanted 99 %; rate met, not proven: at least 5.00 % at 95 % confidence";
    assert!(text(&told.stdout).contains(expected), "{}", text(&told.stdout));
}

/// Each column ends with the key whose value was drawn, and the key with the unit.
#[test]
fn drawn_columns_tell_their_unit() {
    let (_, whole) = whole();
    let head = flights(whole).lines().next().unwrap().to_owned();
    let expected = "run,seed,variant,wind.mean_speed_m_s,mass [share of vehicle.component.*.mass_kg],\
        centre of mass.0 [vehicle.component.0.position_m],centre of mass.1 \
        [vehicle.component.0.position_m],outcome,";
    assert!(head.starts_with(expected), "{head}");
}

#[test]
fn a_file_behind_merge_is_told_where_it_belongs() {
    let (file, whole) = whole();
    let ended = hopbench(&["campaign", "--merge", whole.to_str().unwrap(), file.to_str().unwrap()]);
    assert_eq!(ended.status.code(), Some(2));
    let said = text(&ended.stderr);
    assert!(said.contains("hopbench campaign FILE --merge DIR DIR, with --runs and --seed"), "{said}");
}

#[test]
fn one_flight_alone_is_the_same_bits() {
    let (file, whole) = whole();
    let ended = hopbench(&["campaign", file.to_str().unwrap(), "--only", "43", "--json"]);
    assert_eq!(ended.status.code(), Some(0), "{}", text(&ended.stderr));
    let report: serde_json::Value = serde_json::from_slice(&ended.stdout).unwrap();
    let table = flights(whole);
    let row = table.lines().find(|line| line.starts_with("3,43,nominal,")).unwrap();
    assert_eq!(report["seed"], 43);
    assert!(row.ends_with(report["state_hash"].as_str().unwrap()), "{row}");
    let drawn = row.split(',').nth(3).unwrap();
    let set = format!("wind.mean_speed_m_s={drawn}");
    assert!(report["overrides"].as_array().unwrap().iter().any(|pair| *pair == set.as_str()), "{set}");
}

/// A faster last metre breaks the limit on every seed, so that each pair disagrees: p = 2/2³.
#[test]
fn variants_meet_on_the_same_seeds() {
    let folder = folder("variants");
    let rest = format!(
        "runs = 3\n{DISPERSIONS}\n[[variant]]\nname = \"soft\"\n\
         [[variant]]\nname = \"hard\"\nset = {{ \"mission.terminal_speed_m_s\" = 1.4 }}\n"
    );
    let file = campaign(&folder, &rest);
    let out = folder.join("out");
    let ended = hopbench(&["campaign", file.to_str().unwrap(), "--json", "--out", out.to_str().unwrap()]);
    assert_eq!(ended.status.code(), Some(1), "{}", text(&ended.stderr));
    let summary: serde_json::Value = serde_json::from_slice(&ended.stdout).unwrap();
    assert_eq!(summary["passed"], false);
    assert_eq!(summary["variants"][0]["successes"], 3);
    let failures = &summary["variants"][1]["failures"][0];
    assert_eq!(failures["cause"], "touchdown_vertical_speed");
    assert_eq!(failures["seeds"], serde_json::json!([1, 2, 3]));
    assert!(failures["replay"].as_str().unwrap().contains("--only 1 --variant hard"));
    let comparison = &summary["comparisons"][0];
    assert_eq!((&comparison["only_first"], &comparison["only_second"]), (&3.into(), &0.into()));
    // The binomial law comes from an incomplete beta function, good to 1e-13.
    assert!((comparison["mcnemar_p"].as_f64().unwrap() - 0.25).abs() < 1e-12);
    let faster = &comparison["median_difference"]["touchdown_vertical_speed_m_s"]["value"];
    assert!((0.4..0.8).contains(&faster.as_f64().unwrap()), "{faster}");
    for picture in ["touchdown_soft.svg", "position_hard.svg"] {
        assert!(std::fs::read_to_string(out.join(picture)).unwrap().starts_with("<svg"), "{picture}");
    }
    // Paired: both variants drew the same.
    let table = flights(&out);
    let draws = |line: &str| line.split(',').skip(3).take(4).map(str::to_owned).collect::<Vec<_>>();
    let rows: Vec<&str> = table.lines().skip(1).collect();
    assert!(rows.chunks(2).all(|pair| draws(pair[0]) == draws(pair[1])));
}

#[test]
fn what_is_wrong_is_named_with_line_key_and_range() {
    let folder = folder("wrong");
    let message = |rest: &str| {
        let file = campaign(&folder, rest);
        for command in ["check", "campaign"] {
            let ended = hopbench(&[command, file.to_str().unwrap()]);
            assert_eq!(ended.status.code(), Some(2), "{rest}{}", text(&ended.stdout));
            if command == "campaign" {
                return text(&ended.stderr);
            }
        }
        unreachable!()
    };
    let has = |rest: &str, expected: &str| {
        let message = message(rest);
        assert!(message.contains(expected), "{message}");
    };
    has("runs = 0\n", "short.toml:2: runs: 0 is out of range; allowed 1 to 1000000");
    has("runs = 1\nrums = 2\n", "short.toml:3: rums: unknown key; known here: ");
    let entry = |key: &str, rest: &str| {
        format!("runs = 1\n[[dispersion]]\nkey = \"{key}\"\nsource = \"a test\"\n{rest}")
    };
    let normal = "distribution = \"normal\"\n";
    has(
        &entry("wind.mean_speed_m_s", normal),
        "short.toml:6: dispersion.0.distribution: \"normal\" needs std",
    );
    let wild = format!("{normal}std = 1.0\n");
    has(&entry("wind.speed", &wild), "short.toml:4: dispersion.0.key: wind.speed: unknown key");
    has(&entry("mission.hover_height_m", &wild), "mission.hover_height_m is not left to chance");
    // Drawn values that no vehicle can have: which, of which seed, and where it says so.
    let below = "distribution = \"uniform\"\nlow = -2.0\nhigh = -1.0\nmode = \"value\"\n";
    let refused = message(&entry("vehicle.component.0.mass_kg", below));
    assert!(refused.contains("component.0.mass_kg: -1."), "{refused}");
    assert!(refused.contains("is out of range; allowed 0 to 10000 (given by "), "{refused}");
    assert!(refused.contains("short.toml:3 vehicle.component.0.mass_kg)"), "{refused}");
    assert!(refused.contains("drawn for seed 1: vehicle.component.0.mass_kg = -1."), "{refused}");
    // Two entries of one name would draw as one, whatever their columns are.
    let named = |name: &str, rest: &str| {
        format!("[[dispersion]]\nkey = \"wind.from_deg\"\nsource = \"a test\"\nname = \"{name}\"\n{rest}")
    };
    let disc = "distribution = \"disc\"\nradius = 1.0\n";
    has(
        &format!("runs = 1\n{}{}", named("gust", &wild), named("gust", disc)),
        "short.toml:12: dispersion.1.name: an entry above is \"gust\" too: each needs a name of its own",
    );
    for name in ["", " a", "a,b", "a.0"] {
        let plain = format!("short.toml:6: dispersion.0.name: \"{name}\": letters, digits, - and _ only");
        has(&format!("runs = 1\n{}", named(name, &wild)), &plain);
    }
    for name in ["seed", "state_hash", "control_error_m"] {
        let taken = format!("short.toml:6: dispersion.0.name: \"{name}\" is a column of flights.csv already");
        has(&format!("runs = 1\n{}", named(name, &wild)), &taken);
    }
    let unknown = "runs = 1\n[[variant]]\nname = \"a\"\nset = { \"mission.speed\" = 1 }\n";
    has(unknown, "mission.speed: unknown key");
}

#[test]
fn a_campaign_file_is_explained() {
    let (file, _) = whole();
    let explained = hopbench(&["check", file.to_str().unwrap(), "--explain", "dispersion.distribution"]);
    assert!(text(&explained.stdout).contains("\"disc\": Two numbers"), "{}", text(&explained.stdout));
    let schema = hopbench(&["check", file.to_str().unwrap(), "--schema"]);
    let schema: serde_json::Value = serde_json::from_slice(&schema.stdout).unwrap();
    assert!(schema["properties"]["success"].is_object());
}

#[test]
fn the_campaigns_of_this_repository_can_be_drawn() {
    let mut found = 0;
    for entry in std::fs::read_dir(scenario().parent().unwrap().join("campaigns")).unwrap() {
        let mut campaign = Campaign::open(&entry.unwrap().path(), &[]).unwrap();
        // A rate takes a thousand flights; a comparison lives by its pairs.
        let least = if campaign.file.variant.is_empty() { 1000 } else { 100 };
        assert!(campaign.file.runs >= least, "{}", campaign.name);
        campaign.file.runs = 20;
        campaign.check_draws(&campaign.slots(), 2, &AtomicBool::new(false)).unwrap();
        found += 1;
    }
    assert!(found >= 3);
}

/// The arithmetic beside the entries: moving one part moves the whole vehicle's centre of mass by 10.0 mm, to
/// the last digit given there.
#[test]
fn the_centre_of_mass_moves_as_far_as_the_campaigns_say() {
    for name in ["hop_50m", "hop_50m_gt"] {
        let path = scenario().parent().unwrap().join(format!("campaigns/{name}.toml"));
        let campaign = Campaign::open(&path, &[]).unwrap();
        let (actual, _) = campaign.dispersed(0, 5).unwrap();
        let com_m = |flight: &hopbench::scenario::Scenario| {
            Flight::new(flight, 5).unwrap().snapshot().com_structural_m
        };
        let moved = com_m(&actual) - com_m(&campaign.configurations[0].nominal);
        assert!((moved.xy().norm() - 0.010).abs() < 5e-6, "{name}: {moved}");
        assert_eq!(moved.z, 0.0, "{name}");
    }
}

/// The plant flies what was drawn and the autopilot is told of the file: undispersed the flight is the very
/// same, dispersed the autopilot believes the data sheet.
#[test]
fn the_autopilot_is_told_of_the_nominal_flight() {
    let short: Vec<String> = SHORT.iter().map(|&pair| pair.to_owned()).collect();
    let nominal = load::scenario(&scenario(), &short, None).unwrap();
    let told = data_sheet::nominal(&nominal).unwrap();
    let flown = |mut flight: Flight| {
        fly_out(&mut flight, |_| {});
        let report = flight.report();
        (report.state_hash, report.mass.initial_kg)
    };
    let plain = flown(Flight::new(&nominal, 9).unwrap());
    assert_eq!(plain, flown(Flight::dispersed(&nominal, 9, &told).unwrap()));

    let mut heavier = short.clone();
    heavier.push("vehicle.component.0.mass_kg=11.0".to_owned());
    let actual = load::scenario(&scenario(), &heavier, None).unwrap();
    let dispersed = Flight::dispersed(&actual, 9, &told).unwrap();
    let believed_kg = Flight::new(&nominal, 9).unwrap().estimate().mass_kg;
    assert_eq!(dispersed.estimate().mass_kg, believed_kg);
    let (hash, heavy_kg) = flown(dispersed);
    // The frame has 9 kg in the file.
    assert!((heavy_kg - plain.1 - 2.0).abs() < 1e-9);
    assert_ne!(hash, plain.0);
    assert_ne!(hash, flown(Flight::new(&actual, 9).unwrap()).0, "an autopilot that knew flies otherwise");
}
