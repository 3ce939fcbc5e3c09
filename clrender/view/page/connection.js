// The page's transport: a WebSocket that is opened again when the server comes back.

const FIRST_WAIT = 250; // milliseconds, doubled with each attempt in vain
const LONGEST_WAIT = 4000;

/**
 * A transport as `mount` takes it: `send(text)`, which says whether there is a connection, `onmessage(string | ArrayBuffer)`, `onstate("open" | "lost")`.
 * @param {string} address of the WebSocket
 */
export function connect(address) {
  let socket = null;
  let wait = FIRST_WAIT;
  let timer = null;
  const transport = { send, close, onmessage: () => {}, onstate: () => {} };

  function open() {
    timer = null;
    socket = new WebSocket(address);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => {
      wait = FIRST_WAIT;
      transport.onstate("open");
    };
    socket.onmessage = (event) => transport.onmessage(event.data);
    socket.onclose = () => {
      transport.onstate("lost");
      timer = setTimeout(open, wait);
      wait = Math.min(2 * wait, LONGEST_WAIT);
    };
  }

  function send(text) {
    if (socket?.readyState !== WebSocket.OPEN) return false;
    socket.send(text);
    return true;
  }

  function close() {
    clearTimeout(timer);
    if (socket === null) return;
    socket.onclose = null;
    socket.close();
  }

  // A page that comes to the front again, or a network that is back, need not wait for its turn.
  window.addEventListener("online", () => timer !== null && (clearTimeout(timer), open()));
  setTimeout(open); // after the caller has set its listeners
  return transport;
}
