//! Our own ground station against the flash image, through the terminal of its service port.

use adit_ground::link::{CommandOutcome, Config, Session};
use adit_protocol::log::FlightLog;
use adit_protocol::mavlink::Value;
use adit_protocol::parameters::ParameterTable;

use crate::Served;

#[test]
fn our_ground_sets_parameters_restarts_the_board_and_fetches_its_logs() {
    let board = Served::start();
    let connection = format!("serial:{}:921600", board.port("telem2")).parse().expect("a connection");
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().expect("a runtime");
    let folder = tempfile::tempdir().expect("a folder");
    runtime.block_on(async {
        let session = Session::open(&connection, Config::default()).await.expect("a session");
        let found = session.board().await.expect("a board");
        let parameters = session.parameters(&found, &mut |_, _| {}).await.expect("parameters");
        assert_eq!(parameters.len(), ParameterTable::rows().len());
        session.set_parameter(&found, "RIG_IMAGES", Value::Whole(10)).await.expect("a change");
        assert_eq!(session.restart(&found).await.expect("an answer"), CommandOutcome::Accepted);
        let kept = session.parameter(&found, "RIG_IMAGES").await.expect("a parameter");
        assert_eq!(kept.value.real(), 10.0, "kept over the restart");
        let logs = session.logs(&found).await.expect("logs");
        assert_eq!(logs.len(), 2, "one for each start");
        // The second is being written: a record may grow between two reads of the fetch.
        for (log, (images_per_turn, most_damage)) in logs.into_iter().zip([(12, 0), (10, 1)]) {
            let file = session.fetch_log(&found, log, folder.path(), &mut |_| {}).await.expect("a log");
            let fetched = FlightLog::from_bytes(&std::fs::read(file).expect("a file"));
            assert_eq!(fetched.sessions.len(), 1);
            assert!(fetched.damage.len() <= most_damage, "{:?}", fetched.damage);
            let header = fetched.sessions[0].header.as_ref().expect("a header");
            assert_eq!(header.parameters.rig.images_per_turn, images_per_turn);
        }
        session.close().await.expect("an end");
    });
}
