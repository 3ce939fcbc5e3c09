// What a view knows: messages of the engine, handed to whoever listens, and messages to it with their answers.

/** Messages of the engine that say how things stand: who listens later gets the newest at once. */
const STANDING = ["hello", "devices", "scene", "state", "compiling", "progress"];
const MOST_WAITING = 64;
/** Messages that nobody misses where there is no connection: the page sends them by itself, and again later. */
const UNNOTICED = ["show", "ack", "outline", "environments", "stop_paths"];
const UNSENT = "There is no connection to the renderer, so nothing was changed.";

/**
 * @param {Object} transport `send(text)`, which returns false where it could not; `onmessage(string | ArrayBuffer)` and `onstate("open" | "lost")` are set here
 */
export function createHub(transport) {
  const listeners = new Map(); // type -> functions
  const newest = new Map();
  const waiting = new Map(); // id -> {type, answered}
  let count = 0;

  function tell(type, message) {
    if (STANDING.includes(type)) newest.set(type, message);
    (listeners.get(type) ?? []).forEach((listener) => listener(message));
  }

  transport.onmessage = (data) => {
    if (typeof data !== "string") {
      tell("frame", decodedFrame(data));
      return;
    }
    const message = JSON.parse(data);
    const question = waiting.get(message.id);
    waiting.delete(message.id);
    if (!question?.answered(message)) tell(message.type, message);
  };
  transport.onstate = (state) => {
    if (state === "lost") waiting.clear();
    tell("connection", state);
  };

  return {
    /** Calls a function for each message of a type; also "frame" and "connection". */
    on(type, listener) {
      listeners.set(type, [...(listeners.get(type) ?? []), listener]);
      if (newest.has(type)) listener(newest.get(type));
    },
    /** The newest message of a type that says how things stand, or undefined. */
    newest: (type) => newest.get(type),
    /**
     * Sends a message, and returns its number. `answered` gets a reply to it, where one comes, and returns true where
     * it has told people all that there is to tell. Without a connection the message is refused, with `unsent`.
     */
    send(message, answered) {
      count += 1;
      if (answered !== undefined) waiting.set(count, { type: message.type, answered });
      if (waiting.size > MOST_WAITING) {
        // Most messages have no reply: the oldest of this type goes, and not a probe that cameras have overtaken.
        waiting.delete([...waiting].find(([, { type }]) => type === message.type)?.[0]);
      }
      const id = count;
      if (transport.send(JSON.stringify({ ...message, id })) === false) {
        waiting.delete(id);
        const refusal = { type: "refused", to: message.type, message: UNSENT, unsent: true, id };
        // Later, as any answer: the caller does not know the number yet.
        queueMicrotask(() => {
          if (!answered?.(refusal) && !UNNOTICED.includes(message.type)) tell("refused", refusal);
        });
      }
      return id;
    },
  };
}

/** A binary message: its header, with the numbers as `data` (Float32Array, or Uint16Array of halves). */
function decodedFrame(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  const numbers = header.width * header.height * header.channels;
  const Kind = header.format === "float16" ? Uint16Array : Float32Array;
  return { ...header, data: new Kind(buffer, 4 + length, numbers) };
}
