"""A proxy that cuts connections: what a client meets on a bad line."""

import socket
import threading


class Cutting:
    """Forwards to the service. `cuts` are bytes of the answer after which connection 1, 2, … is cut;
    those that follow are whole. Keeps what clients sent, a connection each."""

    def __init__(self, target, cuts):
        self.target, self.cuts, self.sent = target, list(cuts), []
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.url = "http://127.0.0.1:%d" % self.listener.getsockname()[1]
        threading.Thread(target=self.accept, daemon=True).start()

    def accept(self):
        while True:
            try:
                client, _ = self.listener.accept()
            except OSError:
                return
            left = self.cuts.pop(0) if self.cuts else None
            server = socket.create_connection(self.target)
            place = len(self.sent)
            self.sent.append(b"")
            threading.Thread(target=self.up, args=(client, server, place), daemon=True).start()
            threading.Thread(target=self.down, args=(server, client, left), daemon=True).start()

    def up(self, client, server, place):
        try:
            while data := client.recv(65536):
                self.sent[place] += data
                server.sendall(data)
        except OSError:
            pass

    def down(self, server, client, left):
        try:
            while data := server.recv(65536):
                if left is not None and len(data) >= left:
                    client.sendall(data[:left])
                    break
                left = None if left is None else left - len(data)
                client.sendall(data)
        except OSError:
            pass
        for end in (client, server):
            try:
                end.shutdown(socket.SHUT_RDWR)
            except OSError:
                pass
            end.close()

    def close(self):
        self.listener.close()
