//! Logs over bad lines, in several goes.

use std::fs;

use super::*;

fn content(length: usize, salt: usize) -> Vec<u8> {
    (0..length).map(|index| ((index + salt) * 31 % 253) as u8).collect()
}

fn script(logs: &[(u16, Vec<u8>)]) -> Script {
    Script { logs: logs.to_vec(), ..Script::default() }
}

#[tokio::test]
async fn logs_over_a_bad_line_come_byte_by_byte() {
    let logs = [(3, content(23_456, 1)), (4, content(90 * 20, 2)), (5, content(1, 3))];
    for line in lines() {
        let folder = tempfile::tempdir().unwrap();
        let (session, _board) = connected(&line, Script { damage: 0.2, ..script(&logs) }, config()).await;
        let board = session.board().await.unwrap();
        let found = session.logs(&board).await.unwrap();
        let expected: Vec<_> =
            logs.iter().map(|(number, bytes)| LogEntry { number: *number, bytes: bytes.len() as u32 }).collect();
        assert_eq!(found, expected);
        for (log, (number, bytes)) in found.iter().zip(&logs) {
            let path = session.fetch_log(&board, *log, folder.path(), &mut |_| ()).await.unwrap();
            assert_eq!(path.file_name().unwrap().to_str().unwrap(), format!("ADIT000{number}.LOG"));
            assert_eq!(fs::read(&path).unwrap(), *bytes, "{}", line[1]);
        }
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 3, "no parts are left");
    }
}

#[tokio::test]
async fn a_card_without_logs_says_so() {
    let (session, _board) = over_tcp(Script::default(), config()).await;
    let board = session.board().await.unwrap();
    assert_eq!(session.logs(&board).await.unwrap(), []);
}

#[tokio::test]
async fn a_fetch_that_was_cut_short_goes_on_where_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = content(40_000, 1);
    let cut = Script { log_end: 20_000, ..script(&[(7, bytes.clone())]) };
    let (session, _board) = over_tcp(cut, config()).await;
    let board = session.board().await.unwrap();
    let log = LogEntry { number: 7, bytes: 40_000 };
    let error = session.fetch_log(&board, log, folder.path(), &mut |_| ()).await.unwrap_err();
    assert!(error.to_string().contains("ends at byte 20000, 40000 were expected"), "{error}");
    let part = fs::read(folder.path().join("ADIT0007.LOG.part")).unwrap();
    assert_eq!(part, bytes[..19_980]);

    let (session, scripted) = over_tcp(script(&[(7, bytes.clone())]), config()).await;
    let board = session.board().await.unwrap();
    let path = session.fetch_log(&board, log, folder.path(), &mut |_| ()).await.unwrap();
    assert_eq!(fs::read(&path).unwrap(), bytes);
    let requests = scripted.ledger().log_requests;
    assert_eq!(requests[..3], [(0, 90), (19_890, 90), (19_980, LOG_WINDOW_BYTES)]);
}

#[tokio::test]
async fn the_part_of_another_log_is_begun_anew_and_a_whole_one_is_not_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    let part = folder.path().join("ADIT0007.LOG.part");
    fs::write(&part, content(5_000, 9)).unwrap();
    let bytes = content(12_000, 1);
    let log = LogEntry { number: 7, bytes: 12_000 };
    let (session, scripted) = over_tcp(script(&[(7, bytes.clone())]), config()).await;
    let board = session.board().await.unwrap();
    let path = session.fetch_log(&board, log, folder.path(), &mut |_| ()).await.unwrap();
    assert_eq!(fs::read(&path).unwrap(), bytes);
    let asked = scripted.ledger().log_requests.len();
    assert_eq!(session.fetch_log(&board, log, folder.path(), &mut |_| ()).await.unwrap(), path);
    assert_eq!(scripted.ledger().log_requests.len(), asked + 2, "what is there is compared, not fetched");
    fs::write(&path, content(12_000, 2)).unwrap();
    let error = session.fetch_log(&board, log, folder.path(), &mut |_| ()).await.unwrap_err();
    assert!(matches!(error, LinkError::LogFile { .. }), "{error}");
    assert_eq!(fs::read(&path).unwrap(), content(12_000, 2));
}

#[tokio::test]
async fn a_log_that_has_grown_since_is_fetched_to_its_end() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = content(3_000, 1);
    fs::write(folder.path().join("ADIT0007.LOG"), &bytes[..1_000]).unwrap();
    let (session, _board) = over_tcp(script(&[(7, bytes.clone())]), config()).await;
    let board = session.board().await.unwrap();
    let log = LogEntry { number: 7, bytes: 3_000 };
    let path = session.fetch_log(&board, log, folder.path(), &mut |_| ()).await.unwrap();
    assert_eq!(fs::read(&path).unwrap(), bytes);
}
