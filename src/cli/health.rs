//! `meshway health`: asks a service whether it lives. For images that have no other HTTP client.

use std::io::{Read, Write};
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, TcpStream};
use std::time::Duration;

use clap::Args;

use super::Failure;
use crate::config::address;

/// Time for each step: a probe is repeated anyway.
const PATIENCE: Duration = Duration::from_secs(3);

/// Arguments of `meshway health`.
#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Address of the service; one that stands for all addresses is asked on this machine.
    #[arg(long, env = "MESHWAY_LISTEN", default_value = "127.0.0.1:8080", value_parser = address)]
    listen: SocketAddr,
}

/// Succeeds if the service answers /livez with 200.
pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let mut address = arguments.listen;
    match address.ip() {
        IpAddr::V4(ip) if ip.is_unspecified() => address.set_ip(Ipv4Addr::LOCALHOST.into()),
        IpAddr::V6(ip) if ip.is_unspecified() => address.set_ip(Ipv6Addr::LOCALHOST.into()),
        _ => {}
    }
    match status_line(address) {
        Ok(line) if line.starts_with("HTTP/1.1 200") => Ok(()),
        Ok(line) => Err(Failure::Output(format!("{address} answered {line}"))),
        Err(error) => Err(Failure::Output(format!("{address}: {error}"))),
    }
}

fn status_line(address: SocketAddr) -> std::io::Result<String> {
    let mut stream = TcpStream::connect_timeout(&address, PATIENCE)?;
    stream.set_read_timeout(Some(PATIENCE))?;
    stream.set_write_timeout(Some(PATIENCE))?;
    stream.write_all(b"GET /livez HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n")?;
    let mut head = Vec::new();
    stream.take(1_024).read_to_end(&mut head)?;
    let head = String::from_utf8_lossy(&head);
    Ok(head.lines().next().unwrap_or_default().to_owned())
}
