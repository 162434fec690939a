// This folder is a sketch, too: open this file in the Arduino IDE, choose the board, and upload.
//
// Tools > Board: Arduino Pro or Pro Mini (Processor: ATmega328P, 5V, 16 MHz), Nano or Uno. The program itself is in
// main.c and the files beside it; it replaces Arduino's setup() and loop(), so there is nothing to see here.
// For use through Bluetooth change the rate in settings.h first.
