// The socket to the viewer: what is said, what is told, and coming back when it was gone.

const SOONEST = 500;
const LATEST = 5000;

const GONE = "The viewer does not answer. This page goes on by itself when it is back.";
const OTHER_TOKEN =
  "The viewer was started anew, with another token: open the address that it printed.";
const TOO_MANY = "Too many pages look at this viewer. This one goes on when another is closed.";

// A decoder takes the bytes; a blob goes to another process first, and comes back.
async function decoded(data, type) {
  if (window.ImageDecoder !== undefined) {
    const decoder = new ImageDecoder({data, type, colorSpaceConversion: "none"});
    const {image} = await decoder.decode();
    decoder.close();
    return [image, image.displayWidth, image.displayHeight];
  }
  const blob = new Blob([data], {type});
  const bitmap = await createImageBitmap(blob, {colorSpaceConversion: "none"});
  return [bitmap, bitmap.width, bitmap.height];
}

export class Connection {
  // `told` takes messages, `picture` pictures, `opened` nothing, `lost` why there is none.
  constructor({told, picture, opened, lost}) {
    Object.assign(this, {told, picture, opened, lost});
    this.delay = SOONEST;
    this.socket = null;
    document.addEventListener("visibilitychange", () => this.hurry());
    window.addEventListener("online", () => this.hurry());
    this.open();
  }

  get isOpen() {
    return this.socket?.readyState === WebSocket.OPEN;
  }

  say(type, fields = {}) {
    if (this.isOpen) {
      this.socket.send(JSON.stringify({type, ...fields}));
    }
  }

  open() {
    clearTimeout(this.timer);
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}/socket`);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => {
      this.delay = SOONEST;
      this.lost("");
      this.opened();
    };
    socket.onmessage = ({data}) => {
      if (typeof data === "string") {
        this.told(JSON.parse(data));
      } else {
        this.show(socket, data);
      }
    };
    socket.onclose = () => this.retry();
    this.socket = socket;
  }

  async show(socket, data) {
    const number = new DataView(data).getUint32(0);
    const bytes = new Uint8Array(data, 4);
    const kind = bytes[0] === 0x89 ? "png" : "jpeg";
    try {
      const [bitmap, width, height] = await decoded(bytes, `image/${kind}`);
      if (socket === this.socket) {
        this.picture(bitmap, width, height, number, kind);
      }
      bitmap.close();
    } finally {
      if (socket.readyState === WebSocket.OPEN) {
        socket.send(JSON.stringify({type: "shown", number}));
      }
    }
  }

  async retry() {
    this.timer = setTimeout(() => this.open(), this.delay);
    this.delay = Math.min(2 * this.delay, LATEST);
    let reason = GONE;
    try {
      const {status} = await fetch("/viewer.css");
      reason = status === 403 ? OTHER_TOKEN : this.delay > 4 * SOONEST ? TOO_MANY : GONE;
    } catch {
      reason = GONE;
    }
    if (!this.isOpen) {
      this.lost(reason);
    }
  }

  hurry() {
    if (this.socket.readyState === WebSocket.CLOSED && document.visibilityState === "visible") {
      this.delay = SOONEST;
      this.open();
    }
  }
}
