//! Dependencies kept outside the checkout: they serve a checkout at any other place.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

/// Makes an empty folder below Cargo's own for tests.
fn folder(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    if folder.exists() {
        fs::remove_dir_all(&folder).unwrap();
    }
    fs::create_dir_all(&folder).unwrap();
    folder
}

/// Runs `.ci/dependencies` on a target folder.
fn dependencies(action: &str, target: &Path, kept: &Path) {
    let status = Command::new(super::root().join(".ci/dependencies"))
        .arg(action)
        .arg(target)
        .env("FLEETCAL_DEPENDENCIES", kept)
        .status()
        .unwrap();
    assert!(status.success(), "{action}: {status}");
}

/// Writes a crate's library, its build script's output and the fingerprint of that run.
fn built(target: &Path, name: &str, output: &str) {
    let release = target.join("release");
    for (path, content) in [
        (format!("deps/lib{name}.rlib"), "compiled"),
        (format!("build/{name}-0/out/generated.rs"), output),
        (format!(".fingerprint/{name}-0/run-build-script"), "0"),
    ] {
        let path = release.join(path);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, content).unwrap();
    }
}

#[test]
fn what_names_its_own_target_folder_is_built_again_elsewhere() {
    let (kept, here, there) = (folder("kept"), folder("here"), folder("there"));
    built(&here, "plain", "const A: u8 = 0;");
    let own = here.join("release/build/bound-0/out/page.js");
    built(&here, "bound", &format!("include_bytes!({own:?})"));
    dependencies("keep", &here, &kept);
    dependencies("restore", &there, &kept);
    let restored = |path: &str| there.join("release").join(path).exists();
    assert!(restored("deps/libplain.rlib") && restored("deps/libbound.rlib"));
    assert!(restored("build/plain-0/out/generated.rs"));
    assert!(restored(".fingerprint/plain-0/run-build-script"));
    assert!(!restored("build/bound-0/out/generated.rs"));
    assert!(!restored(".fingerprint/bound-0/run-build-script"));
}

#[test]
fn of_the_kept_folders_the_last_three_stay_and_nothing_else_is_touched() {
    let (kept, here) = (folder("kept_beside_others"), folder("here_beside_others"));
    built(&here, "plain", "const A: u8 = 0;");
    fs::create_dir(kept.join("photos")).unwrap();
    fs::write(kept.join("photos/one.jpg"), "one").unwrap();
    let now = fs::metadata(&here).unwrap().modified().unwrap();
    let then = now - Duration::from_hours(5);
    for (age, name) in ["1.90.0-a", "1.90.0-b", "1.90.0-c"].into_iter().enumerate() {
        fs::create_dir(kept.join(name)).unwrap();
        let mark = fs::File::create(kept.join(name).join("complete")).unwrap();
        mark.set_modified(then + Duration::from_secs(age as u64))
            .unwrap();
    }
    dependencies("keep", &here, &kept);
    assert!(!kept.join("1.90.0-a").exists());
    assert!(kept.join("1.90.0-b").exists() && kept.join("1.90.0-c").exists());
    assert!(kept.join("photos/one.jpg").exists());
    assert_eq!(fs::read_dir(&kept).unwrap().count(), 4);
}
