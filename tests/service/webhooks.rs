//! Messages on their way: receivers that are slow, dead, gone, elsewhere, or not who they seem to be.

use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use hmac::{Hmac, KeyInit, Mac};
use meshway::jobs::{Delivery, DeliveryState, NewWebhook, News, Problem, Webhook, WebhookChange};
use meshway::webhooks::{Policy, Post, Resolve, Sender};
use serde_json::json;
use sha2::Sha256;
use tokio::net::TcpListener;
use tokio_util::sync::{CancellationToken, DropGuard};

use crate::receiver::{Receiver, Seen};
use crate::server::{Folder, PATIENCE, until};
use crate::store::support::Bench;
use crate::who::{ours, us};

const HOUR_MS: i64 = 60 * 60 * 1_000;

fn policy(ports: &[u16]) -> Policy {
    Policy {
        networks: vec!["127.0.0.1/32".parse().unwrap()],
        ports: ports.to_vec(),
    }
}

/// A resolver that knows one answer, and counts how often it is asked.
fn fixed(addresses: &[SocketAddr]) -> (Resolve, Arc<AtomicUsize>) {
    let (addresses, asked) = (addresses.to_vec(), Arc::new(AtomicUsize::new(0)));
    let counted = Arc::clone(&asked);
    let resolve: Resolve = Arc::new(move |_, _| {
        counted.fetch_add(1, Ordering::SeqCst);
        let addresses = addresses.clone();
        Box::pin(async move { Ok(addresses) })
    });
    (resolve, asked)
}

/// Sends what the store has until the guard is dropped.
fn send(bench: &Bench, post: Post) -> DropGuard {
    let shutdown = CancellationToken::new();
    tokio::spawn(Sender::new(bench.store.clone(), post).run(shutdown.clone()));
    shutdown.drop_guard()
}

async fn hook(bench: &Bench, url: String) -> Webhook {
    let new = NewWebhook {
        url,
        events: News::ALL.to_vec(),
        secret: vec![7; 32],
    };
    let made = bench.acts().create_webhook(new, 9).await.unwrap();
    made.unwrap()
}

/// Ends a job, of which webhooks are told.
async fn fail_one(bench: &Bench) {
    bench.submit().await;
    let claim = bench.claim().await;
    let problem = Problem::new("no_surface", "Anna's scan has none");
    bench.store.fail(&claim, problem).await.unwrap();
}

async fn messages(bench: &Bench, hook: &Webhook) -> Vec<Delivery> {
    let records = bench.records();
    let mut messages = records.deliveries(&hook.id, None, 100).await.unwrap();
    messages.reverse();
    messages
}

/// The only message to a webhook, once it was tried so often.
async fn tried(bench: &Bench, hook: &Webhook, tries: u32) -> Delivery {
    until("the message is tried", PATIENCE, async || {
        let message = messages(bench, hook).await.remove(0);
        (message.tries >= tries).then_some(message)
    })
    .await
}

#[tokio::test]
async fn a_message_is_signed_thin_and_sent_once() {
    let bench = Bench::new().await;
    let receiver = Receiver::default();
    let address = receiver.start().await;
    let hook = hook(&bench, format!("http://{address}/hook?for=ris")).await;
    let _sender = send(&bench, Post::new(policy(&[address.port()]), None).unwrap());
    fail_one(&bench).await;
    let seen = receiver.sees(1).await.remove(0);
    assert_eq!(seen.path, "/hook?for=ris");
    assert_eq!(seen.header("host"), address.to_string());
    let (id, seconds) = (seen.header("webhook-id"), seen.header("webhook-timestamp"));
    assert_eq!(seconds, (bench.store.now() / 1_000).to_string());
    let mut mac = Hmac::<Sha256>::new_from_slice(&[7; 32]).unwrap();
    mac.update(format!("{id}.{seconds}.").as_bytes());
    mac.update(&seen.body);
    let expected = format!("v1,{}", STANDARD.encode(mac.finalize().into_bytes()));
    assert_eq!(seen.header("webhook-signature"), expected);
    let message = tried(&bench, &hook, 1).await;
    assert_eq!(message.state(), DeliveryState::Delivered);
    assert_eq!((message.id.as_str(), message.status), (id, Some(204)));
    let body = seen.json();
    assert_eq!(body["type"], "job.failed");
    assert_eq!(body["timestamp"], "1970-01-01T00:16:40Z");
    let data = json!({"job_id": message.data["job_id"], "batch_id": null,
                      "error": {"code": "no_surface", "retryable": false}});
    assert_eq!(body["data"], data);
    bench.pass(30 * 24 * HOUR_MS);
    bench.store.wake();
    tokio::time::sleep(Duration::from_millis(500)).await;
    assert_eq!(receiver.seen().len(), 1);
    bench.pass(HOUR_MS);
    bench.store.forget_deliveries().await.unwrap();
    assert!(messages(&bench, &hook).await.is_empty());
}

#[tokio::test]
async fn a_receiver_that_is_down_for_an_hour_gets_all_in_the_end() {
    let bench = Bench::new().await;
    // A port that nobody listens on yet.
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    drop(listener);
    let hook = hook(&bench, format!("http://{address}/")).await;
    let _sender = send(&bench, Post::new(policy(&[address.port()]), None).unwrap());
    fail_one(&bench).await;
    let first = tried(&bench, &hook, 1).await;
    assert_eq!(first.state(), DeliveryState::Waiting);
    let error = first.error.clone().unwrap();
    assert!(error.contains("refused"), "{error}");
    let start = bench.store.now();
    // What ends meanwhile is not lost either.
    fail_one(&bench).await;
    while bench.store.now() < start + HOUR_MS {
        bench.pass(60_000);
        bench.store.wake();
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    let receiver = Receiver::default();
    receiver.serve(TcpListener::bind(address).await.unwrap());
    until("both are delivered", PATIENCE, async || {
        bench.pass(60_000);
        bench.store.wake();
        tokio::time::sleep(Duration::from_millis(20)).await;
        let all = messages(&bench, &hook).await;
        let delivered = |message: &Delivery| message.state() == DeliveryState::Delivered;
        all.iter().all(delivered).then_some(())
    })
    .await;
    let mut ids: Vec<_> = receiver
        .seen()
        .iter()
        .map(|seen| seen.header("webhook-id").to_owned())
        .collect();
    ids.sort();
    let expected: Vec<_> = messages(&bench, &hook)
        .await
        .iter()
        .map(|m| m.id.to_string())
        .collect();
    assert_eq!(ids, expected);
}

#[tokio::test]
async fn one_that_is_gone_gets_no_more_until_it_is_enabled() {
    let bench = Bench::new().await;
    let receiver = Receiver::default();
    receiver.answer(410, "x", "gone");
    let address = receiver.start().await;
    let hook = hook(&bench, format!("http://{address}/")).await;
    let _sender = send(&bench, Post::new(policy(&[address.port()]), None).unwrap());
    fail_one(&bench).await;
    let message = tried(&bench, &hook, 1).await;
    assert_eq!(
        (message.state(), message.status),
        (DeliveryState::Failed, Some(410))
    );
    let state = || async {
        bench
            .records()
            .webhook(&hook.id)
            .await
            .unwrap()
            .unwrap()
            .state
            .name()
    };
    assert_eq!(state().await, "gone");
    fail_one(&bench).await;
    tokio::time::sleep(Duration::from_millis(500)).await;
    assert_eq!(receiver.seen().len(), 1);
    let enable = WebhookChange {
        enabled: Some(true),
        ..WebhookChange::default()
    };
    bench
        .acts()
        .change_webhook(&hook.id, enable)
        .await
        .unwrap()
        .unwrap();
    receiver.sees(2).await;
    assert_eq!(state().await, "enabled");
    // The one that failed is sent when it is asked for.
    bench.acts().redeliver(&message.id).await.unwrap().unwrap();
    let seen = receiver.sees(3).await;
    assert_eq!(seen[0].header("webhook-id"), seen[2].header("webhook-id"));
    assert_eq!(seen[0].body, seen[2].body);
}

#[tokio::test]
async fn no_redirect_is_followed() {
    let bench = Bench::new().await;
    let (receiver, elsewhere) = (Receiver::default(), Receiver::default());
    let other = elsewhere.start().await;
    let location: &'static str = Box::leak(format!("http://{other}/").into_boxed_str());
    receiver.answer(307, "location", location);
    let address = receiver.start().await;
    let hook = hook(&bench, format!("http://{address}/")).await;
    let ports = [address.port(), other.port()];
    let _sender = send(&bench, Post::new(policy(&ports), None).unwrap());
    fail_one(&bench).await;
    let message = tried(&bench, &hook, 1).await;
    assert_eq!(
        (message.state(), message.status),
        (DeliveryState::Waiting, Some(307))
    );
    assert!(message.error.unwrap().contains("redirect"));
    assert!(elsewhere.seen().is_empty());
}

#[tokio::test]
async fn a_name_that_stands_for_a_place_inside_is_not_connected_to() {
    let bench = Bench::new().await;
    let receiver = Receiver::default();
    let address = receiver.start().await;
    // 127.0.0.1 is allowed; 127.0.0.2 leads to the same machine, and is not.
    for addresses in [
        &["127.0.0.2"][..],
        &["127.0.0.1", "127.0.0.2"],
        &["::1"],
        &["::ffff:127.0.0.2"],
        &["169.254.169.254"],
        &["10.0.0.1", "8.8.8.8"],
        &[],
    ] {
        let port = address.port();
        let found: Vec<SocketAddr> = addresses
            .iter()
            .map(|address| SocketAddr::new(address.parse().unwrap(), port))
            .collect();
        let (resolve, _) = fixed(&found);
        let post = Post::new(policy(&[port]), None).unwrap().resolving(resolve);
        let hook = hook(&bench, format!("http://ris.example:{port}/")).await;
        let _sender = send(&bench, post);
        fail_one(&bench).await;
        let message = tried(&bench, &hook, 1).await;
        let error = message.error.unwrap();
        assert!(error.contains("address"), "{addresses:?}: {error}");
        assert_eq!(message.status, None);
        bench.acts().delete_webhook(&hook.id).await.unwrap();
    }
    assert!(receiver.seen().is_empty());
}

#[tokio::test]
async fn a_name_is_resolved_once_for_the_check_and_the_connection() {
    let bench = Bench::new().await;
    let receiver = Receiver::default();
    let address = receiver.start().await;
    // From the second look on it stands for a place that is not allowed.
    let asked = Arc::new(AtomicUsize::new(0));
    let counted = Arc::clone(&asked);
    let resolve: Resolve = Arc::new(move |_, port| {
        let first = counted.fetch_add(1, Ordering::SeqCst) == 0;
        let inside = if first {
            [127, 0, 0, 1]
        } else {
            [127, 0, 0, 2]
        };
        Box::pin(async move { Ok(vec![SocketAddr::from((inside, port))]) })
    });
    let post = Post::new(policy(&[address.port()]), None)
        .unwrap()
        .resolving(resolve);
    let hook = hook(&bench, format!("http://ris.example:{}/", address.port())).await;
    let _sender = send(&bench, post);
    fail_one(&bench).await;
    assert_eq!(
        tried(&bench, &hook, 1).await.state(),
        DeliveryState::Delivered
    );
    assert_eq!(asked.load(Ordering::SeqCst), 1);
    assert_eq!(
        receiver.seen()[0].header("host"),
        format!("ris.example:{}", address.port())
    );
}

#[tokio::test]
async fn a_receiver_that_never_answers_delays_nobody() {
    let bench = Bench::new().await;
    // It takes connections and says nothing.
    let silent = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let dead = silent.local_addr().unwrap();
    let receiver = Receiver::default();
    let address = receiver.start().await;
    let dead_hook = hook(&bench, format!("http://{dead}/")).await;
    hook(&bench, format!("http://{address}/")).await;
    let ports = [address.port(), dead.port()];
    let _sender = send(&bench, Post::new(policy(&ports), None).unwrap());
    for _ in 0..20 {
        fail_one(&bench).await;
    }
    receiver.sees(20).await;
    let waiting = messages(&bench, &dead_hook).await;
    assert!(
        waiting
            .iter()
            .all(|message| message.tries == 0 && message.due_at.is_some())
    );
}

#[tokio::test]
async fn a_new_secret_signs_beside_the_old_one_for_a_day() {
    let bench = Bench::new().await;
    let receiver = Receiver::default();
    let address = receiver.start().await;
    let hook = hook(&bench, format!("http://{address}/")).await;
    let _sender = send(&bench, Post::new(policy(&[address.port()]), None).unwrap());
    let renew = WebhookChange {
        secret: Some((vec![8; 32], 24 * HOUR_MS)),
        ..WebhookChange::default()
    };
    bench
        .acts()
        .change_webhook(&hook.id, renew)
        .await
        .unwrap()
        .unwrap();
    fail_one(&bench).await;
    receiver.sees(1).await;
    bench.pass(24 * HOUR_MS);
    fail_one(&bench).await;
    let seen = receiver.sees(2).await;
    let signatures = |seen: &Seen| seen.header("webhook-signature").split(' ').count();
    assert_eq!((signatures(&seen[0]), signatures(&seen[1])), (2, 1));
}

#[tokio::test]
async fn a_service_that_is_killed_sends_again_what_it_does_not_know_to_be_taken() {
    let folder = Folder::new().await;
    // The first try is never answered.
    let silent = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = silent.local_addr().unwrap();
    let ports = format!("--webhook-ports={}", address.port());
    let flags = ["--webhook-networks=127.0.0.0/8", &ports];
    let new = NewWebhook {
        url: format!("http://{address}/"),
        events: News::ALL.to_vec(),
        secret: vec![7; 32],
    };
    let made = folder.store.by(us()).create_webhook(new, 9).await.unwrap();
    let hook = made.unwrap();
    let server = folder.serve(&flags).await;
    let job = folder.submit(json!({})).await;
    folder.end(&job).await;
    drop(silent.accept().await.unwrap().0);
    drop(server);
    let receiver = Receiver::default();
    receiver.serve(silent);
    let _server = folder.serve(&flags).await;
    let seen = until("the message arrives", PATIENCE, async || {
        Some(receiver.seen()).filter(|seen| !seen.is_empty())
    })
    .await;
    let all = folder
        .store
        .of(ours())
        .deliveries(&hook.id, None, 10)
        .await
        .unwrap();
    assert_eq!(all.len(), 1);
    assert_eq!(seen[0].header("webhook-id"), all[0].id.as_str());
    assert_eq!(seen[0].json()["type"], "job.succeeded");
    assert_eq!(seen[0].json()["data"]["job_id"], job.as_str());
    assert!(seen[0].json()["data"]["verdict"].is_string());
}
