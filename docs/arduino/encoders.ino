// Two wheel encoders streamed over USB for beemap: `time_us,left,right*checksum`, 100 lines a
// second. In rig.yaml: devices: {encoders: /dev/ttyACM0, protocol: stream, baud: 115200,
// checked: true}, encoders: {counter_bits: 32, ...}.
//
// Channel A of each encoder must be on a pin with an interrupt (2 and 3 on an Uno or Nano).

const byte LEFT_A = 2, LEFT_B = 4;
const byte RIGHT_A = 3, RIGHT_B = 5;
const unsigned long PERIOD_US = 10000;

volatile long leftCount = 0;
volatile long rightCount = 0;

void leftChanged() {
  if (digitalRead(LEFT_A) == digitalRead(LEFT_B)) leftCount++; else leftCount--;
}

void rightChanged() {
  if (digitalRead(RIGHT_A) == digitalRead(RIGHT_B)) rightCount++; else rightCount--;
}

void setup() {
  pinMode(LEFT_A, INPUT_PULLUP);
  pinMode(LEFT_B, INPUT_PULLUP);
  pinMode(RIGHT_A, INPUT_PULLUP);
  pinMode(RIGHT_B, INPUT_PULLUP);
  attachInterrupt(digitalPinToInterrupt(LEFT_A), leftChanged, CHANGE);
  attachInterrupt(digitalPinToInterrupt(RIGHT_A), rightChanged, CHANGE);
  Serial.begin(115200);
  // Tells the host that the counters begin at zero.
  Serial.println(F("# beemap encoders, ready"));
}

void loop() {
  static unsigned long due = 0;
  // Unsigned differences are right when micros() wraps, every 71 minutes.
  if ((long)(micros() - due) < 0) return;
  due += PERIOD_US;

  // A count of four bytes must not change while it is read.
  noInterrupts();
  const unsigned long now = micros();
  const long left = leftCount;
  const long right = rightCount;
  interrupts();

  char line[48];
  snprintf(line, sizeof line, "%lu,%ld,%ld", now, left, right);
  byte checksum = 0;
  for (const char *c = line; *c; c++) checksum ^= *c;
  Serial.print(line);
  Serial.print('*');
  Serial.println(checksum);
}
