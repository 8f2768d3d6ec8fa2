//! Texts of queries, the robots that they select, and refusals.

use fleetcal_domain::limits;
use fleetcal_domain::robot::{ConnectionState, RobotState};
use fleetcal_domain::standing::Standing;
use fleetcal_model::{Label, VehicleModel};
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;

use super::*;

fn label(text: &str) -> Label {
    Label::parse(text).unwrap()
}

/// Tells which of these queries select the robot.
fn selected<'q>(robot: &Properties, queries: &[&'q str]) -> Vec<&'q str> {
    let selects = |query: &&&str| query.parse::<Query>().unwrap().selects(robot);
    queries.iter().filter(selects).copied().collect()
}

/// Robot of which little is known.
fn robot(id: &str) -> Properties<'_> {
    Properties {
        id,
        site: None,
        vehicle_type: None,
        tags: &[],
        model: None,
        state: RobotState::Calibrated,
        standing: Standing::AwaitingApproval,
        is_stale: true,
        in_maintenance: false,
        deviation: None,
        age_s: None,
    }
}

#[test]
fn a_query_selects_the_robots_that_meet_all_of_it() {
    let (site, kind) = (label("Hamburg"), label("EKX 516"));
    let tags = [label("leased"), label("night shift")];
    let robot = Properties {
        site: Some(&site),
        vehicle_type: Some(&kind),
        tags: &tags,
        model: Some(VehicleModel::Tricycle),
        deviation: Some(1.5),
        age_s: Some(601.0),
        ..robot("Tugger_01")
    };
    let met = [
        "",
        "tugger",
        "-agv",
        "id:tugger_01",
        "id:agv_1,tugger_01",
        "site:hamburg model:tricycle deviation>1",
        "site:munich,HAMBURG",
        "type:\"ekx 516\"",
        "tag:leased tag:\"Night Shift\"",
        "-tag:spare",
        "state:calibrated",
        "standing:awaiting_approval connection:silent",
        "standing:\"awaiting approval\"",
        "deviation>=1.5 deviation<=1.5",
        "deviation:>1",
        "age>10m age<1h",
        "-age>1d",
        "-no:site,tag",
    ];
    assert_eq!(selected(&robot, &met), met);
    let not_met = [
        "agv",
        "-tugger",
        "site:hamburg site:munich",
        "model:bicycle",
        "connection:online",
        "connection:maintenance",
        "deviation<1.5",
        "age<601s",
        "no:type",
    ];
    assert_eq!(selected(&robot, &not_met), [""; 0]);
}

#[test]
fn an_unknown_property_meets_no_condition_but_its_opposite() {
    let bare = Properties {
        in_maintenance: true,
        ..robot("Tugger_01")
    };
    let met = [
        "no:site",
        "no:type no:tag no:model no:deviation no:age",
        "-deviation>1",
        "-deviation<1",
        "age>3650d",
        "connection:maintenance",
        "-connection:silent",
        "-site:hamburg",
    ];
    assert_eq!(selected(&bare, &met), met);
    let not_met = ["deviation<100", "age<1d", "connection:silent,online"];
    assert_eq!(selected(&bare, &not_met), [""; 0]);
    let driving = Properties {
        is_stale: false,
        ..bare
    };
    let both = ["connection:maintenance", "connection:online"];
    assert_eq!(selected(&driving, &both), both);
}

#[test]
fn a_refusal_names_the_part_its_position_and_what_is_accepted() {
    for (text, refusal) in [
        (
            "tugger modle:tricycle",
            "got \"modle\" at character 8, expected one of id:, site:, type:, tag:, model:, state:, \
             standing:, connection:, no:, deviation>, age>, or a robot's name",
        ),
        (
            "model:truck",
            "got \"truck\" at character 7, expected one of bicycle, tricycle, rear_steered",
        ),
        (
            "connection:online,off",
            "got \"off\" at character 19, expected one of online, silent, maintenance",
        ),
        (
            "deviation>x",
            "got \"x\" at character 11, expected a number of tolerances, such as 1 or 2.5",
        ),
        (
            "deviation>1e9",
            "got \"1e9\" at character 11, expected a number of tolerances, such as 1 or 2.5",
        ),
        (
            "age>10",
            "got \"10\" at character 5, expected a time, such as 30s, 10m, 8h or 7d",
        ),
        (
            "age:10m",
            "got \"10m\" at character 5, expected <, <=, > or >= after age",
        ),
        (
            "site>=2",
            "got \">=\" at character 5, expected a colon after site",
        ),
        (
            "site: x",
            "got \"\" at character 6, expected a value; in quotes if it has spaces or commas",
        ),
        (
            "é site:\"a",
            "got \"\\\"a\" at character 8, expected a quote at its end",
        ),
        (
            "a -",
            "got \"-\" at character 3, expected a condition after -",
        ),
        (
            "\"a\"b",
            "got \"b\" at character 4, expected a space between two conditions",
        ),
        (
            "no:legs",
            "got \"legs\" at character 4, expected one of site, type, tag, model, deviation, age",
        ),
    ] {
        let refused = text.parse::<Query>().unwrap_err();
        assert_eq!(refused.to_string(), refusal, "{text}");
    }
    let most = "a ".repeat(limits::VIEW_QUERY_TERMS_MAX);
    assert!(most.parse::<Query>().is_ok());
    let refused = format!("{most}b").parse::<Query>().unwrap_err().to_string();
    let expected = "got \"b\" at character 101, expected at most 50 conditions";
    assert_eq!(refused, expected);
    let long = "a ".repeat(1_001);
    let refused = long.parse::<Query>().unwrap_err().to_string();
    assert!(refused.ends_with("expected at most 2000 characters, these are 2002"));
}

#[test]
fn equal_queries_have_one_text() {
    for (typed, written) in [
        ("  a   B ", "a B"),
        ("SITE:Hamburg", "site:Hamburg"),
        ("site:\"Hamburg\"", "site:Hamburg"),
        ("standing:Awaiting-Approval", "standing:awaiting_approval"),
        ("deviation:>=01.50", "deviation>=1.5"),
        ("age>010m", "age>10m"),
        ("\"-x\" \"a:b\" \"c d\"", "\"-x\" \"a:b\" \"c d\""),
    ] {
        let query: Query = typed.parse().unwrap();
        assert_eq!(query.to_string(), written);
    }
}

fn values(of: &'static [&'static str]) -> impl Strategy<Value = Vec<String>> {
    vec(select(of).prop_map(str::to_owned), 1..4)
}

fn known(of: &'static [&'static str]) -> impl Strategy<Value = Vec<Folded>> {
    values(of).prop_map(|values| values.into_iter().map(Folded::from).collect())
}

fn any_text() -> impl Strategy<Value = String> {
    prop_oneof![any::<String>(), "[-a:<>\", \\\\]{1,6}"]
        .prop_filter("a value is not empty", |text| !text.is_empty())
}

fn conditions() -> impl Strategy<Value = Condition> {
    let open = select(&[Word::Id, Word::Site, Word::Type, Word::Tag][..]);
    let comparison = || select(Comparison::VARIANTS);
    let amount = (0..2_000_000_u32).prop_map(|thousandths| f64::from(thousandths) / 1e3);
    prop_oneof![
        any_text().prop_map(|text| Condition::Text(text.into())),
        (open, vec(any_text().prop_map(Folded::from), 1..4))
            .prop_map(|(word, values)| Condition::Has(word, values)),
        known(&["bicycle", "tricycle", "rear_steered"])
            .prop_map(|of| Condition::Has(Word::Model, of)),
        known(&["drift", "awaiting_approval"]).prop_map(|of| Condition::Has(Word::Standing, of)),
        known(&["silent", "maintenance"]).prop_map(|of| Condition::Has(Word::Connection, of)),
        values(&["site", "tag", "deviation"]).prop_map(Condition::Lacks),
        (comparison(), amount).prop_map(|(sign, than)| Condition::Deviation(sign, than)),
        (comparison(), any::<u32>(), select(TimeUnit::VARIANTS))
            .prop_map(|(sign, count, unit)| Condition::Age(sign, count, unit)),
    ]
}

fn queries() -> impl Strategy<Value = Query> {
    let term = (any::<bool>(), conditions()).prop_map(|(is_negated, condition)| Term {
        is_negated,
        condition,
    });
    vec(term, 0..6).prop_map(Query)
}

proptest! {
    #[test]
    fn what_is_written_is_read_as_the_same(query in queries()) {
        let written = query.to_string();
        if written.chars().count() <= limits::VIEW_QUERY_CHARS_MAX {
            prop_assert_eq!(written.parse::<Query>(), Ok(query), "{}", written);
        }
    }

    #[test]
    fn any_text_is_read_or_refused_at_a_place_in_it(
        text in prop_oneof![any::<String>(), "([a-z:<>=\"\\\\, -]|deviation|age|site:|no:|1){0,12}"],
    ) {
        match text.parse::<Query>() {
            Ok(query) => prop_assert_eq!(query.to_string().parse::<Query>(), Ok(query)),
            Err(refused) => {
                let from = refused.position - 1;
                let rest: String = text.chars().skip(from).collect();
                prop_assert!(rest.starts_with(&refused.token), "{:?} in {:?}", refused, text);
            }
        }
    }
}

#[test]
fn every_connection_is_a_value() {
    for state in ConnectionState::ALL {
        let text = format!("connection:{}", state.name());
        assert_eq!(text.parse::<Query>().unwrap().to_string(), text);
    }
}
