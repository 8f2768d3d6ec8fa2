use super::golden::bytes;
use super::*;

// Bytes that an independent implementation (the Python package `rosbags`) wrote.

/// Two rows of two points with six fields, in little-endian CDR.
const CLOUD: &str = "0001000000f1536580b2e60e060000006c6964617200000002000000020000000600000002000000780000000000\
    000007000000010000000200000079000000040000000700000001000000020000007a0000000800000007000000\
    010000000a000000696e74656e736974790000000c00000004000000010000000500000072696e67000000000e00\
    0000020000000100000002000000740000000f000000060000000100000000000000140000002800000050000000\
    0000803f000000800000803e640000000000000000000040000000800000803e650000e8030000000000803f0000\
    00c00000803e640001000000000000000040000000c00000803e650001e80300000001";
/// The same cloud in big-endian CDR; the points' own bytes are little-endian still.
const CLOUD_BIG: &str = "000000006553f1000ee6b280000000066c6964617200000000000002000000020000000600000002780000000000\
    000007000000000000010000000279000000000000040700000000000001000000027a0000000000000807000000\
    000000010000000a696e74656e736974790000000000000c04000000000000010000000572696e67000000000000\
    000e020000000000000100000002740000000000000f060000000000000100000000000000140000002800000050\
    0000803f000000800000803e640000000000000000000040000000800000803e650000e8030000000000803f0000\
    00c00000803e640001000000000000000040000000c00000803e650001e80300000001";
/// One point with a number of each type, least significant byte first.
const EVERY_TYPE: &str = "0001000000f1536580b2e60e060000006c6964617200000001000000010000000800000003000000663100000000\
    00000100000001000000030000006632000001000000020000000100000003000000663300000200000003000000\
    01000000030000006634000004000000040000000100000003000000663500000600000005000000010000000300\
    0000663600000a000000060000000100000003000000663700000e00000007000000010000000300000066380000\
    120000000800000001000000000000001a0000001a0000001a000000fbfa48f460ea90eefeff00286bee0000c0bf\
    3a8c30e28e79253e00";
/// The same point, most significant byte first.
const EVERY_TYPE_BIG: &str = "0001000000f1536580b2e60e060000006c6964617200000001000000010000000800000003000000663100000000\
    00000100000001000000030000006632000001000000020000000100000003000000663300000200000003000000\
    01000000030000006634000004000000040000000100000003000000663500000600000005000000010000000300\
    0000663600000a000000060000000100000003000000663700000e00000007000000010000000300000066380000\
    120000000800000001000000010000001a0000001a0000001a000000fbfaf448ea60fffeee90ee6b2800bfc00000\
    3e25798ee2308c3a00";

pub(super) fn cloud() -> PointCloud2 {
    let field = |name: &str, offset, datatype| PointField {
        name: name.into(),
        offset,
        datatype,
        count: 1,
    };
    let mut data = Vec::new();
    for (row, column) in [(0_u8, 0_u16), (0, 1), (1, 0), (1, 1)] {
        for number in [1.0 + f32::from(column), -2.0 * f32::from(row), 0.25] {
            data.extend(number.to_le_bytes());
        }
        data.extend((100 + column).to_le_bytes());
        data.push(row);
        data.extend((1000 * u32::from(column)).to_le_bytes());
        data.push(0);
    }
    PointCloud2 {
        header: header("lidar"),
        height: 2,
        width: 2,
        fields: vec![
            field("x", 0, PointDatatype::Float32),
            field("y", 4, PointDatatype::Float32),
            field("z", 8, PointDatatype::Float32),
            field("intensity", 12, PointDatatype::Uint16),
            field("ring", 14, PointDatatype::Uint8),
            field("t", 15, PointDatatype::Uint32),
        ],
        is_bigendian: false,
        point_step: 20,
        row_step: 40,
        data: data.into(),
        is_dense: true,
    }
}

fn numbers(cloud: &PointCloud2, name: &'static str) -> Vec<f64> {
    cloud.check_layout().unwrap();
    let column = cloud.needed_column(name).unwrap();
    cloud.points().map(|point| column.read(point)).collect()
}

#[test]
fn a_cloud_reads_and_writes_the_bytes_of_others() {
    assert_eq!(PointCloud2::from_cdr(&bytes(CLOUD)).unwrap(), cloud());
    assert_eq!(PointCloud2::from_cdr(&bytes(CLOUD_BIG)).unwrap(), cloud());
    assert_eq!(cloud().to_cdr(), bytes(CLOUD));
}

#[test]
fn points_are_read_row_after_row() {
    let mut cloud = cloud();
    assert_eq!(numbers(&cloud, "x"), [1.0, 2.0, 1.0, 2.0]);
    assert_eq!(numbers(&cloud, "y"), [0.0, 0.0, -2.0, -2.0]);
    assert_eq!(numbers(&cloud, "intensity"), [100.0, 101.0, 100.0, 101.0]);
    assert_eq!(numbers(&cloud, "t"), [0.0, 1000.0, 0.0, 1000.0]);
    // Rows may be padded.
    let padded = |row: &[u8]| [row, &[0xaa; 5]].concat();
    cloud.data = cloud.data.chunks(40).flat_map(padded).collect();
    cloud.row_step = 45;
    assert_eq!(numbers(&cloud, "x"), [1.0, 2.0, 1.0, 2.0]);
    assert_eq!(numbers(&cloud, "ring"), [0.0, 0.0, 1.0, 1.0]);
    // An unorganised cloud has one row, and may have no points.
    let flat = PointCloud2 {
        height: 1,
        width: 4,
        row_step: 80,
        ..self::cloud()
    };
    assert_eq!(numbers(&flat, "t"), [0.0, 1000.0, 0.0, 1000.0]);
    for (height, width) in [(1, 0), (0, 0), (0, 7)] {
        let empty = PointCloud2 {
            height,
            width,
            row_step: width * 20,
            data: Vec::new().into(),
            ..self::cloud()
        };
        assert!(numbers(&empty, "x").is_empty());
    }
}

#[test]
fn every_type_is_read_in_either_byte_order() {
    let wanted = [-5.0, 250.0, -3000.0, 60_000.0, -70_000.0, 4e9, -1.5, 2.5e-9];
    let names = ["f1", "f2", "f3", "f4", "f5", "f6", "f7", "f8"];
    for (hex, is_bigendian) in [(EVERY_TYPE, false), (EVERY_TYPE_BIG, true)] {
        let cloud = PointCloud2::from_cdr(&bytes(hex)).unwrap();
        assert_eq!(cloud.is_bigendian, is_bigendian);
        for (name, wanted) in names.into_iter().zip(wanted) {
            assert_eq!(numbers(&cloud, name), [wanted], "{name}");
        }
    }
    for (number, datatype) in (1_u8..).zip(PointDatatype::ALL) {
        assert_eq!(PointDatatype::try_from(number), Ok(datatype));
        assert_eq!(u8::from(datatype), number);
    }
}

#[test]
fn json_has_base64_or_numbers() {
    let json = String::from_utf8(cloud().to_json().unwrap()).unwrap();
    assert!(json.contains(r#""datatype":7"#), "{json}");
    assert_eq!(PointCloud2::from_json(json.as_bytes()).unwrap(), cloud());
    let mut value: serde_json::Value = serde_json::from_str(&json).unwrap();
    value["data"] = cloud().data.to_vec().into();
    assert_eq!(
        PointCloud2::from_json(value.to_string().as_bytes()).unwrap(),
        cloud()
    );
    for (path, wrong) in [
        ("data", "\"%\""),
        ("data", "[256]"),
        ("datatype", "9"),
        ("is_dense", "3"),
    ] {
        let text = match path {
            "data" => {
                value["data"] = serde_json::from_str(wrong).unwrap();
                value.to_string()
            }
            "datatype" => json.replace("\"datatype\":7", "\"datatype\":9"),
            _ => json.replace("\"is_dense\":true", "\"is_dense\":3"),
        };
        let reason = PointCloud2::from_json(text.as_bytes())
            .unwrap_err()
            .to_string();
        assert!(reason.contains(path), "{reason} does not name {path}");
    }
}

#[test]
fn a_hostile_cloud_is_refused_before_anything_is_allocated() {
    let whole = bytes(CLOUD);
    let refusal = |at: usize, value: u32| {
        let mut payload = whole.clone();
        payload[at..at + 4].copy_from_slice(&value.to_le_bytes());
        PointCloud2::from_cdr(&payload).unwrap_err().to_string()
    };
    // The counts of fields and of bytes.
    assert!(refusal(32, u32::MAX).contains("fields claims 4294967295"));
    assert!(refusal(32, 8).contains("fields"));
    let data_at = whole.len() - 1 - 80 - 4;
    assert!(refusal(data_at, u32::MAX).contains("data claims 4294967295 elements"));
    let mut kind = whole.clone();
    kind[48] = 9;
    let reason = PointCloud2::from_cdr(&kind).unwrap_err().to_string();
    assert!(
        reason.contains("fields.datatype: got 9, expected 1 to 8"),
        "{reason}"
    );
    let many = PointCloud2 {
        fields: vec![cloud().fields[0].clone(); 65],
        ..cloud()
    };
    let reason = PointCloud2::from_cdr(&many.to_cdr())
        .unwrap_err()
        .to_string();
    assert!(reason.contains("fields claims 65 elements, expected at most 64"));
    let reason = PointCloud2::from_json(&many.to_json().unwrap())
        .unwrap_err()
        .to_string();
    assert!(reason.contains("fields"), "{reason}");
}

#[test]
fn a_layout_that_contradicts_itself_is_refused_by_field() {
    let refusal = |change: &dyn Fn(&mut PointCloud2)| {
        let mut cloud = cloud();
        change(&mut cloud);
        cloud.check_layout().unwrap_err().to_string()
    };
    for (change, wanted) in [
        (
            (&|cloud: &mut PointCloud2| cloud.width = 3) as &dyn Fn(&mut PointCloud2),
            "row_step: got 40, expected width times point_step, 60 bytes",
        ),
        (
            &|cloud| cloud.height = 3,
            "data: got 80 bytes, expected row_step times height, 120",
        ),
        (
            &|cloud| cloud.point_step = 12,
            "fields: got \"intensity\" up to byte 14",
        ),
        (
            &|cloud| {
                cloud.fields.clear();
                cloud.point_step = 0;
            },
            "point_step: got 0",
        ),
        (
            &|cloud| cloud.fields[0].count = u32::MAX,
            "fields: got \"x\" up to byte 17179869180",
        ),
        (
            &|cloud| cloud.fields[0].offset = u32::MAX,
            "fields: got \"x\" up to byte 4294967299",
        ),
        (
            &|cloud| (cloud.width, cloud.height) = (u32::MAX, u32::MAX),
            "4294967295 by 4294967295 points, expected at most 1048576",
        ),
        (&|cloud| cloud.row_step = u32::MAX, "data: got 80 bytes"),
    ] {
        let reason = refusal(change);
        assert!(
            reason.contains(wanted),
            "{reason:?} does not say {wanted:?}"
        );
    }
    let reason = cloud().needed_column("height").unwrap_err().to_string();
    assert!(reason.contains("[x, y, z, intensity, ring, t], expected a list with \"height\""));
}
