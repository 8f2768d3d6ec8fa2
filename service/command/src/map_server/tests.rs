use fleetcal_estimator::occupancy_grid::Occupancy::{self, Free, Occupied, Unknown};
use fleetcal_model::Pose2;
use tempfile::TempDir;

use super::*;

const YAML: &str = "image: map.pgm\nresolution: 0.050000\norigin: [-1.0, 2.5, 0.1]\n\
                    negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n";
/// Three by two pixels as `map_saver` writes them: occupied, unknown, free over free, occupied, free.
const PIXELS: [u8; 6] = [0, 205, 254, 254, 0, 254];

/// Writes a folder with a map; returns the path of its description.
fn map(yaml: &str, image: &[u8]) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("map.yaml");
    std::fs::write(&path, yaml).expect("written");
    std::fs::write(folder.path().join("map.pgm"), image).expect("written");
    (folder, path)
}

fn binary() -> Vec<u8> {
    let mut image = b"P5\n# CREATOR: map_saver.cpp 0.050 m/pix\n3 2\n255\n".to_vec();
    image.extend(PIXELS);
    image
}

fn cells(grid: &OccupancyGrid) -> Vec<Occupancy> {
    let rows = 0..grid.height() as i64;
    rows.flat_map(|row| (0..grid.width() as i64).map(move |column| grid.at(column, row)))
        .collect()
}

fn read_map(yaml: &str, image: &[u8]) -> Result<OccupancyGrid, String> {
    let (_folder, path) = map(yaml, image);
    read(&path).map_err(|refused| refused.to_string())
}

#[test]
fn a_saved_map_is_read_from_its_lowest_row_up() {
    let grid = read_map(YAML, &binary()).expect("as map_saver writes it");
    assert_eq!((grid.width(), grid.height()), (3, 2));
    assert_eq!(
        cells(&grid),
        [Free, Occupied, Free, Occupied, Unknown, Free]
    );
    assert!((grid.resolution_m() - 0.05).abs() < 1e-12);
    let first = Pose2::new(-1.0, 2.5, 0.1).compose(&Pose2::new(0.025, 0.025, 0.0));
    assert!((grid.centre_m(0, 0) - first.translation()).norm() < 1e-12);
}

#[test]
fn plain_text_and_other_depths_say_the_same() {
    let wanted = read_map(YAML, &binary()).expect("binary");
    let text = b"P2\n3 2 # wide, high\n255\n0 205 254\n254 0 254\n";
    assert_eq!(read_map(YAML, text).expect("P2"), wanted);
    let mut deep = b"P5 3 2 65535\n".to_vec();
    deep.extend(PIXELS.iter().flat_map(|&shade| [shade, 0]));
    assert_eq!(read_map(YAML, &deep).expect("16 bits"), wanted);
    let small = b"P2 3 2 15\n0 12 15\n15 0 15\n";
    assert_eq!(read_map(YAML, small).expect("4 bits"), wanted);
}

#[test]
fn modes_and_negation_change_what_a_shade_means() {
    let negated = YAML.replace("negate: 0", "negate: 1");
    let grid = read_map(&negated, &binary()).expect("negated");
    assert_eq!(
        cells(&grid),
        [Occupied, Free, Occupied, Free, Occupied, Occupied]
    );
    let negated = YAML.replace("negate: 0", "negate: true");
    assert_eq!(read_map(&negated, &binary()).expect("negated"), grid);
    let raw = format!("{YAML}mode: raw\n");
    let image = b"P2 3 2 255\n0 65 64\n19 20 255\n";
    let grid = read_map(&raw, image).expect("raw");
    assert_eq!(
        cells(&grid),
        [Free, Unknown, Unknown, Free, Occupied, Unknown]
    );
    let scale = format!("{YAML}mode: scale\n");
    let grid = read_map(&scale, &binary()).expect("scale");
    assert_eq!(Ok(grid), read_map(YAML, &binary()));
}

#[test]
fn each_field_that_cannot_be_is_named_with_value_and_what_is_accepted() {
    let swap = |from: &str, to: &str| {
        assert!(YAML.contains(from));
        YAML.replace(from, to)
    };
    for (yaml, wanted) in [
        (
            swap("image: map.pgm\n", ""),
            "image: got nothing, expected the name",
        ),
        (swap("image: map.pgm", "image: [1]"), "image: got [1]"),
        (
            swap("resolution: 0.050000", "resolution: fine"),
            "resolution: got \"fine\"",
        ),
        (
            swap("resolution: 0.050000", "resolution: -0.05"),
            "resolution: got -0.05, expected 0.01 to 0.25",
        ),
        (
            swap("resolution: 0.050000", "resolution: .inf"),
            "line 2 column 13: non-finite float `.inf`",
        ),
        (
            swap("[-1.0, 2.5, 0.1]", "[-1.0, 2.5]"),
            "origin: got [-1.0,2.5], expected [x, y, yaw]",
        ),
        (
            swap("[-1.0, 2.5, 0.1]", "[-1.0, two, 0.1]"),
            "origin: got [-1.0,\"two\",0.1]",
        ),
        (
            swap("[-1.0, 2.5, 0.1]", "[-1e9, 2.5, 0.1]"),
            "origin: got [-1000000000, 2.5, 0.1]",
        ),
        (
            swap("negate: 0", "negate: 2"),
            "negate: got 2, expected 0 or 1",
        ),
        (
            swap("occupied_thresh: 0.65", "occupied_thresh: 65"),
            "occupied_thresh: got 65, expected a number from 0 to 1",
        ),
        (
            swap("free_thresh: 0.196", "free_thresh: 0.7"),
            "free_thresh: got 0.7, expected a number from 0 to 1, below",
        ),
        (swap("free_thresh: 0.196\n", ""), "free_thresh: got nothing"),
        (
            format!("{YAML}mode: quaternary\n"),
            "mode: got \"quaternary\", expected trinary, scale or raw",
        ),
        ("just words".to_owned(), "map.yaml is refused"),
        ("image: [".to_owned(), "map.yaml is refused"),
        (format!("{YAML}image: other.pgm\n"), "map.yaml is refused"),
    ] {
        let reason = read_map(&yaml, &binary()).expect_err(wanted);
        assert!(
            reason.contains(wanted),
            "{reason:?} does not say {wanted:?}"
        );
        assert!(!reason.contains('\n'), "{reason:?}");
    }
}

#[test]
fn an_image_that_cannot_be_is_refused_by_field() {
    let whole = binary();
    for (damaged, wanted) in [
        (&whole[..whole.len() - 1], "image: got 5 bytes of pixels"),
        (b"P5 3", "image height: got nothing"),
        (b"", "image: got \"\", expected a PGM image"),
        (b"GIF89a", "image: got \"GI\""),
        (b"P5 0 2 255\n", "image width: got 0, expected 1 or more"),
        (b"P5 -3 2 255\n", "image width: got -3"),
        (
            b"P5 3 2 0\n123456",
            "image maxval: got 0, expected a largest shade",
        ),
        (b"P5 3 2 65536\n123456", "image maxval: got 65536"),
        (b"P5 3 2 100\n\x65aaaaa", "image pixel: got 101"),
        (b"P2 3 2 255\n0 205 254 254 0\n", "image pixel: got nothing"),
        (b"P2 3 2 255\n0 205 254 254 0 x\n", "image pixel: got x"),
        (
            b"P2 3 2 255\n0 205 254 254 0 256\n",
            "image pixel: got 256, expected a shade",
        ),
        (
            b"P5 100000 100000 255\n",
            "image: got 100000 by 100000 pixels",
        ),
        (b"P2 4294967295 4294967295 1\n", "image: got 4294967295 by"),
        (b"P2 8192 8192 255\n1 2 3", "image pixel: got nothing"),
    ] {
        let reason = read_map(YAML, damaged).expect_err(wanted);
        assert!(reason.contains("map.pgm is refused: "), "{reason}");
        assert!(
            reason.contains(wanted),
            "{reason:?} does not say {wanted:?}"
        );
    }
    let blank = b"P2 2 1 255\n254 254\n";
    assert!(
        read_map(YAML, blank)
            .expect_err("blank")
            .contains("none occupied")
    );
}

#[test]
fn a_missing_or_endless_file_is_refused() {
    let other = YAML.replace("map.pgm", "other.pgm");
    let reason = read_map(&other, &binary()).expect_err("not there");
    assert!(
        reason.contains("cannot read") && reason.contains("other.pgm"),
        "{reason}"
    );
    let long = format!("{YAML}# {}\n", "x".repeat(70_000));
    assert!(
        read_map(&long, &binary())
            .expect_err("long")
            .contains("expected 65536 at most")
    );
}

proptest::proptest! {
    #[test]
    fn no_bytes_break_it(bytes in proptest::collection::vec(proptest::num::u8::ANY, 0..64)) {
        drop(pgm::Pgm::parse(&bytes));
        drop(pgm::Pgm::parse(&[b"P2 3 2 9 ", bytes.as_slice()].concat()));
        drop(description::Description::parse(&String::from_utf8_lossy(&bytes)));
    }
}
