// The line to the server: news come in by topic, orders go out, a lost line is taken up again.

const RETRY_MS = [300, 700, 1500, 3000];
const DECODER = new TextDecoder();

/** What was sent at once, as [topic, values, blob] each; `pipeline/web/messages.py` tells how. */
function* unpacked(buffer) {
  const view = new DataView(buffer);
  for (let at = 0; at < buffer.byteLength;) {
    const head = view.getUint32(at, true), blob = view.getUint32(at + 4, true);
    const { topic, ...values } = JSON.parse(DECODER.decode(new Uint8Array(buffer, at + 8, head)));
    yield [topic, values, new Uint8Array(buffer, at + 8 + head, blob)];
    at += 8 + head + blob;
  }
}

/**
 * Watch the server. topics: {topic: (values, blob) => ...}, which may be async: the next news come
 * when all have ended. onLine("open" | "lost" | "refused"): how the line is.
 * Returns order(name, value), false where there is no line.
 */
export function watch(topics, onLine) {
  let socket = null, failures = 0;

  async function receive(buffer) {
    for (const [topic, values, blob] of unpacked(buffer)) {
      try {
        await topics[topic]?.(values, blob);
      } catch (error) {
        console.error(`${topic}: ${error}`);
      }
    }
    if (socket?.readyState === WebSocket.OPEN) socket.send('{"do":"seen"}');
  }

  function connect() {
    socket = new WebSocket(`${location.protocol.replace("http", "ws")}//${location.host}/live`);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => { failures = 0; onLine("open"); };
    socket.onmessage = (event) => receive(event.data);
    socket.onclose = lost;
  }

  async function lost() {
    socket = null;
    onLine("lost");
    while (true) {
      const wait = RETRY_MS[Math.min(failures++, RETRY_MS.length - 1)];
      await new Promise((later) => setTimeout(later, wait));
      // A WebSocket that is refused does not say why.
      const answer = await fetch("/", { method: "HEAD" }).catch(() => null);
      if (answer?.ok) return connect();
      if (answer?.status === 403) return onLine("refused");
    }
  }

  connect();
  return (name, value = "") => {
    if (socket?.readyState !== WebSocket.OPEN) return false;
    socket.send(JSON.stringify({ do: name, value }));
    return true;
  };
}
